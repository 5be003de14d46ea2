// Cloud to surface against the stock tools, on the same clouds in the same run; prints times and ratios.
// Usage: geometry_bench [Google Benchmark's options]
#include <sys/utsname.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <benchmark/benchmark.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/segment_differences.h>
#include <opencv2/imgproc.hpp>

#include "pipeline/delaunay.h"
#include "pipeline/segment.h"
#include "pipeline/volume.h"
#include "tests/bench/box_scene.h"

namespace granary {
namespace {

constexpr int kWidth = BoxScene::kWidth, kHeight = BoxScene::kHeight;
constexpr double kDistance_m = 0.004;

const std::vector<Eigen::Vector3f>& FullBox() {
  static const auto cloud = SeeBox(true, 1);
  return cloud;
}
const std::vector<Eigen::Vector3f>& EmptyBox() {
  static const auto cloud = SeeBox(false, 2);
  return cloud;
}

/// A second picture of the empty bin: every point has a near one.
const std::vector<Eigen::Vector3f>& ShallowBox() {
  static const auto cloud = SeeBox(false, 4);
  return cloud;
}

std::vector<Eigen::Vector2d> Plan() {
  std::vector<Eigen::Vector2d> plan;
  for (const auto& p : FullBox()) plan.emplace_back(p.x(), p.y());
  return plan;
}

void TriangulateOurs(benchmark::State& state) {
  const auto plan = Plan();
  for (auto _ : state) {
    const auto triangles = TriangulateDelaunay(plan);
    state.counters["triangles"] = static_cast<double>(triangles.size());
  }
}

void TriangulateGrid(benchmark::State& state) {
  std::vector<Eigen::Vector2d> plan;
  for (int i = 0; i < kWidth * kHeight; ++i) plan.emplace_back(0.0004 * (i % kWidth), 0.0004 * (i / kWidth));
  for (auto _ : state) benchmark::DoNotOptimize(TriangulateDelaunay(plan));
}

void TriangulateRandom(benchmark::State& state) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Eigen::Vector2d> plan;
  for (int i = 0; i < kWidth * kHeight; ++i) plan.emplace_back(unit(random), unit(random));
  for (auto _ : state) benchmark::DoNotOptimize(TriangulateDelaunay(plan));
}

void TriangulateSubdiv2D(benchmark::State& state) {
  // In millimetres: its vertex tolerance is fixed, and in metres it throws.
  std::vector<cv::Point2f> plan;
  for (const auto& p : FullBox()) plan.emplace_back(1000 * p.x(), 1000 * p.y());
  const cv::Rect bounds = cv::boundingRect(plan);
  for (auto _ : state) {
    cv::Subdiv2D subdivision({bounds.x - 1, bounds.y - 1, bounds.width + 3, bounds.height + 3});
    for (const auto& point : plan) subdivision.insert(point);
    std::vector<cv::Vec6f> triangles;
    subdivision.getTriangleList(triangles);
    state.counters["triangles"] = static_cast<double>(triangles.size());
  }
}

void RunFindScenePoints(benchmark::State& state, const std::vector<Eigen::Vector3f>& points) {
  const auto& empty = EmptyBox();
  for (auto _ : state) {
    const auto scene = FindScenePoints(points, empty, kDistance_m);
    state.counters["grain"] = static_cast<double>(std::count(scene.begin(), scene.end(), 0));
  }
}

void SegmentOurs(benchmark::State& state) { RunFindScenePoints(state, FullBox()); }
void SegmentShallowOurs(benchmark::State& state) { RunFindScenePoints(state, ShallowBox()); }

pcl::PointCloud<pcl::PointXYZ>::Ptr PclCloud(const std::vector<Eigen::Vector3f>& points) {
  auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  for (const auto& p : points) cloud->push_back({p.x(), p.y(), p.z()});
  return cloud;
}

/// FLANN splits a flat cloud in x and y only, so for grain d above the floor it opens all leaves within d sideways:
/// the time of PCL grows with the depth of the grain. The shallow pair is its best case.
void RunPclDifferences(benchmark::State& state, const std::vector<Eigen::Vector3f>& points) {
  const auto full = PclCloud(points), empty = PclCloud(EmptyBox());
  for (auto _ : state) {
    pcl::SegmentDifferences<pcl::PointXYZ> difference;
    difference.setInputCloud(full);
    difference.setTargetCloud(empty);
    difference.setDistanceThreshold(kDistance_m * kDistance_m);  // PCL compares squared distances with it
    pcl::PointCloud<pcl::PointXYZ> grain;
    difference.segment(grain);
    state.counters["grain"] = static_cast<double>(grain.size());
  }
}

void SegmentPclDifferences(benchmark::State& state) { RunPclDifferences(state, FullBox()); }
void SegmentShallowPcl(benchmark::State& state) { RunPclDifferences(state, ShallowBox()); }

/// A warehouse: 5 M points 12 mm apart on a wavy surface, the empty floor under it, 68 mm of distance.
void SegmentWarehouse(benchmark::State& state) {
  const auto lift = static_cast<float>(state.range(0)) / 1000;
  std::vector<Eigen::Vector3f> full, empty;
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0, 0.004F);
  for (int y = 0; y < 2048; ++y) {
    for (int x = 0; x < 2448; ++x) {
      const float wx = 0.012F * static_cast<float>(x), wy = 0.012F * static_cast<float>(y);
      const float floor = 0.3F * std::sin(wx) + 0.2F * wy;
      empty.emplace_back(wx, wy, floor + noise(random));
      full.emplace_back(wx, wy, floor + lift + noise(random));
    }
  }
  for (auto _ : state) benchmark::DoNotOptimize(FindScenePoints(full, empty, 0.068));
}

void FilterPassThrough(benchmark::State& state) {
  const auto& points = FullBox();
  for (auto _ : state) benchmark::DoNotOptimize(PassThroughZ(points, 0, 0.285F));
}

void FilterOutliers(benchmark::State& state) {
  const std::span<const Eigen::Vector3f> half(FullBox().data(), 500'000);
  for (auto _ : state) benchmark::DoNotOptimize(FindOutliers(half, 0.002, 5));
}

void FitFloor(benchmark::State& state) {
  const auto& points = EmptyBox();
  for (auto _ : state) benchmark::DoNotOptimize(FitFloorPlane(points, kDistance_m));
}

void IntegrateSurface(benchmark::State& state) {
  Surface surface;
  for (const auto& p : FullBox()) {
    surface.vertices_in_world.push_back(p.cast<double>());
    surface.height_m.push_back(p.z());
  }
  surface.interpolated.assign(FullBox().size(), 0);
  surface.triangles = TriangulateDelaunay(Plan());
  surface.triangle_interpolated.assign(surface.triangles.size(), 0);
  for (auto _ : state) benchmark::DoNotOptimize(IntegrateVolume(surface));
}

#define GRANARY_BENCHMARK(function) BENCHMARK(function)->Unit(benchmark::kMillisecond)->UseRealTime()
GRANARY_BENCHMARK(TriangulateOurs)->Iterations(5);
GRANARY_BENCHMARK(TriangulateSubdiv2D)->Iterations(1);
GRANARY_BENCHMARK(TriangulateGrid)->Iterations(2);
GRANARY_BENCHMARK(TriangulateRandom)->Iterations(3);
GRANARY_BENCHMARK(SegmentOurs)->Iterations(10);
GRANARY_BENCHMARK(SegmentPclDifferences)->Iterations(1);  // minutes
GRANARY_BENCHMARK(SegmentShallowOurs)->Iterations(10);
GRANARY_BENCHMARK(SegmentShallowPcl)->Iterations(1);
GRANARY_BENCHMARK(SegmentWarehouse)->Arg(0)->Arg(80)->Arg(1000)->Iterations(2);
GRANARY_BENCHMARK(FilterPassThrough)->Iterations(5);
GRANARY_BENCHMARK(FilterOutliers)->Iterations(1);
GRANARY_BENCHMARK(FitFloor)->Iterations(3);
GRANARY_BENCHMARK(IntegrateSurface)->Iterations(3);

/// Prints as usual and remembers the times for the ratios.
class Reporter : public benchmark::ConsoleReporter {
 public:
  Reporter() : ConsoleReporter(OO_None) {}
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      const std::string name = run.run_name.function_name;
      wall_ms_[name] = run.GetAdjustedRealTime();
      cpu_ms_[name] = run.GetAdjustedCPUTime();
    }
  }
  void PrintRatio(const char* ours, const char* stock) const {
    if (!wall_ms_.count(ours) || !wall_ms_.count(stock)) return;
    std::printf("%s is %.1f times as fast as %s (wall), %.1f (CPU of the calling thread)\n", ours,
                wall_ms_.at(stock) / wall_ms_.at(ours), stock, cpu_ms_.at(stock) / cpu_ms_.at(ours));
  }

 private:
  std::map<std::string, double> wall_ms_, cpu_ms_;
};

void PrintMachine(int count, char** arguments) {
  utsname name{};
  uname(&name);
  std::string line, model = name.machine;
  for (std::ifstream cpu("/proc/cpuinfo"); std::getline(cpu, line);) {
    if (line.starts_with("model name")) model = line.substr(line.find(':') + 2);
  }
  std::printf("%s, %u threads, %s, load", model.c_str(), std::thread::hardware_concurrency(), name.sysname);
  double load = 0;
  if (getloadavg(&load, 1) == 1) std::printf(" %.1f", load);
  std::printf("; %d points a cloud\ncommand:", kWidth * kHeight);
  for (int i = 0; i < count; ++i) std::printf(" %s", arguments[i]);
  std::printf("\n");
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) {
  granary::PrintMachine(argc, argv);
  std::fflush(stdout);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  granary::Reporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);
  reporter.PrintRatio("TriangulateOurs", "TriangulateSubdiv2D");
  reporter.PrintRatio("SegmentOurs", "SegmentPclDifferences");
  reporter.PrintRatio("SegmentShallowOurs", "SegmentShallowPcl");
  return 0;
}
