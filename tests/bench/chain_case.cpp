// The clouds are made before the peak is reset: what counts is what the chain itself needs.
#include "tests/bench/chain_case.h"

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <optional>
#include <stdexcept>

#include <tbb/global_control.h>
#include <opencv2/core.hpp>

#include "pipeline/delaunay.h"
#include "pipeline/floor.h"
#include "pipeline/grain.h"
#include "pipeline/large_pages.h"
#include "pipeline/local_planes.h"
#include "pipeline/segment.h"
#include "pipeline/surface.h"
#include "pipeline/volume.h"
#include "tests/bench/box_scene.h"

namespace granary {

Times Now() {
  timespec cpu{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  const auto wall = std::chrono::steady_clock::now().time_since_epoch();
  return {std::chrono::duration<double, std::milli>(wall).count(),
          1e3 * static_cast<double>(cpu.tv_sec) + 1e-6 * static_cast<double>(cpu.tv_nsec)};
}

double Status_mib(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(key + ":")) return std::atof(line.c_str() + key.size() + 1) / 1024;
  }
  throw std::runtime_error("no " + key + " in /proc/self/status");
}

void ResetPeak() {
  std::ofstream clear("/proc/self/clear_refs");
  if (!(clear << "5" << std::flush)) throw std::runtime_error("/proc/self/clear_refs cannot be written");
}

namespace {

constexpr double kDistance_m = 0.004;

cv::Mat AsPicture(const std::vector<Eigen::Vector3f>& cloud) {
  cv::Mat points(BoxScene::kHeight, BoxScene::kWidth, CV_32FC3);
  for (int i = 0; i < static_cast<int>(cloud.size()); ++i) {
    const Eigen::Vector3f& p = cloud[static_cast<std::size_t>(i)];
    points.at<cv::Vec3f>(i / BoxScene::kWidth, i % BoxScene::kWidth) = {p.x(), p.y(), p.z()};
  }
  return points;
}

cv::Mat DisparityOf(const cv::Mat& points) {
  cv::Mat disparity(points.size(), CV_32FC1);
  for (int y = 0; y < points.rows; ++y) {
    for (int x = 0; x < points.cols; ++x) {
      const double depth_m = BoxScene::kCamera - points.at<cv::Vec3f>(y, x)[2];
      disparity.at<float>(y, x) = static_cast<float>(BoxScene::kFocal_px * BoxScene::kBaseline_m / depth_m);
    }
  }
  return disparity;
}

Bin PaperBox() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {BoxScene::kLength, 0}, {BoxScene::kLength, BoxScene::kBreadth}, {0, BoxScene::kBreadth}};
  bin.height_m = BoxScene::kTop;
  return bin;
}

std::vector<Eigen::Vector3f> AsPoints(const cv::Mat& picture) {
  std::vector<Eigen::Vector3f> points;
  for (const cv::Vec3f& p : cv::Mat_<cv::Vec3f>(picture)) points.emplace_back(p[0], p[1], p[2]);
  return points;
}

template <typename Work>
ChainFigures::Step Time(const char* name, Work&& work) {
  ChainFigures::Step fastest{name, {std::numeric_limits<double>::infinity(), 0}};
  for (int i = 0; i < 3; ++i) {
    const Times start = Now();
    work();
    const Times taken = Now() - start;
    if (taken.wall_ms < fastest.times.wall_ms) fastest.times = taken;
  }
  return fastest;
}

/// The costliest parts of the steps, each alone.
std::vector<ChainFigures::Step> TimeParts(const cv::Mat& points, const cv::Mat& empty, const Surface& surface) {
  const std::vector<Eigen::Vector3f> full = AsPoints(points), empty_bin = AsPoints(empty);
  std::vector<Eigen::Vector2d> plan;
  std::vector<Eigen::Vector3d> measured;
  for (std::size_t i = 0; i < surface.vertices_in_world.size(); ++i) {
    plan.emplace_back(surface.vertices_in_world[i].head<2>());
    if (!surface.interpolated[i]) measured.push_back(surface.vertices_in_world[i]);
  }
  return {
      Time("FindScenePoints, all points", [&] { static_cast<void>(FindScenePoints(full, empty_bin, kDistance_m)); }),
      Time("LocalPlanes", [&] { const LocalPlanes planes(measured, 5 * surface.point_spacing_m); }),
      Time("TriangulateDelaunay", [&] { static_cast<void>(TriangulateDelaunay(plan)); })};
}

}  // namespace

ChainFigures RunOurChain(int threads, int repetitions) {
  UseLargePagesForPictures();  // as our programs do
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  cv::setNumThreads(threads);
  const Bin bin = PaperBox();
  const double spacing_m = BoxScene::kCamera / BoxScene::kFocal_px;
  const cv::Mat points = AsPicture(SeeBox(true, 1)), empty = AsPicture(SeeBox(false, 2));
  const cv::Mat disparity = DisparityOf(points);
  Floor floor;
  {
    std::vector<Eigen::Vector3d> seen;
    for (const Eigen::Vector3f& p : AsPoints(empty)) seen.emplace_back(p.cast<double>());
    floor = Floor(seen, bin, 10 * spacing_m, 5 * kDistance_m, 6 * spacing_m);
  }
  GrainOptions options;
  options.segment_distance_m = kDistance_m;
  options.edge_margin_m = 6 * spacing_m;

  ChainFigures out;
  out.total.wall_ms = std::numeric_limits<double>::infinity();
  Surface surface;
  for (int i = 0; i <= repetitions; ++i) {
    surface = {};
    if (i == 0) {  // the peak of the first is the one that a single measurement has
      ResetPeak();
      out.before_mib = Status_mib("VmRSS");
    }
    const Times start = Now();
    const GrainPoints grain = FindGrain(points, disparity, empty, floor, bin, options);
    const Times found = Now();
    surface = BuildSurface(grain.points_in_world, floor, bin, grain.spacing_m, std::nullopt);
    const Times built = Now();
    out.volume_m3 = IntegrateVolume(surface).total_m3;
    const Times end = Now();
    if (i == 0) out.peak_mib = Status_mib("VmHWM");
    if (i == 0 || (end - start).wall_ms >= out.total.wall_ms) continue;
    out.total = end - start;
    out.steps = {{"FindGrain", found - start}, {"BuildSurface", built - found}, {"IntegrateVolume", end - built}};
  }
  out.triangles = surface.triangles.size();
  out.apart = TimeParts(points, empty, surface);
  return out;
}

}  // namespace granary
