// Everything is decided a pixel on masks; the exact nearest-neighbour rule of METHOD §5 is segment.h's.
#include "pipeline/grain.h"

#include <algorithm>
#include <cmath>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <opencv2/imgproc.hpp>

#include "pipeline/large_pages.h"
#include "pipeline/segment.h"

namespace granary {

namespace {

// Near the empty bin, and at most this many segment distances from the floor: bare floor or the thin toe of a heap. One
// would leave a gap where the toe is as high as the distance, as the nearest point of a noisy floor lies nearer.
constexpr double kFloorDistances = 1.5;

// 255 near a jump of the disparity, where a matching window straddles two surfaces.
cv::Mat NearStep(const cv::Mat& disparity, int margin_px) {
  constexpr float kStep_px = 1.5f;
  cv::Mat step = cv::Mat::zeros(disparity.size(), CV_8UC1);
  for (int y = 0; y < disparity.rows; ++y) {
    const float* here = disparity.ptr<float>(y);
    const float* below = y + 1 < disparity.rows ? disparity.ptr<float>(y + 1) : here;
    for (int x = 0; x < disparity.cols; ++x) {
      if (!std::isfinite(here[x])) continue;
      const auto jumps = [&](float other) { return std::isfinite(other) && std::abs(other - here[x]) > kStep_px; };
      if (jumps(below[x]) || (x + 1 < disparity.cols && jumps(here[x + 1]))) step.at<std::uint8_t>(y, x) = 255;
    }
  }
  cv::Mat near;
  cv::dilate(step, near, cv::Mat::ones(2 * margin_px + 1, 2 * margin_px + 1, CV_8UC1));
  return near;
}

// 255 where a disparity departs from the median of its 5×5 neighbours: a spike the blob filter left.
cv::Mat Spikes(const cv::Mat& disparity) {
  constexpr float kSpike_px = 1.0f;
  cv::Mat filled = disparity.clone(), median;
  filled.setTo(0, disparity == std::numeric_limits<float>::infinity());
  cv::medianBlur(filled, median, 5);
  return cv::abs(filled - median) > kSpike_px;
}

// Takes single points and small groups of them out of `mask`: a handful, left over where all around was rejected, is no
// surface, and one of them may be anything.
void DropStragglers(cv::Mat& mask) {
  constexpr int kWindow_px = 7;
  constexpr double kFewest = 12;  // of the 49; at the straight edge of a surface there are 28
  cv::Mat share;
  cv::boxFilter(mask, share, CV_32F, {kWindow_px, kWindow_px}, {-1, -1}, true, cv::BORDER_CONSTANT);
  mask.setTo(0, share < 255 * kFewest / (kWindow_px * kWindow_px) - 1e-3);
}

std::vector<Eigen::Vector3f> FinitePoints(const cv::Mat& points) {
  auto out = ReserveLarge<Eigen::Vector3f>(points.total());
  for (int y = 0; y < points.rows; ++y) {
    for (const auto* p = points.ptr<cv::Vec3f>(y); p != points.ptr<cv::Vec3f>(y) + points.cols; ++p) {
      if (std::isfinite((*p)[2])) out.emplace_back((*p)[0], (*p)[1], (*p)[2]);
    }
  }
  return out;
}

double MedianSpacing_m(const cv::Mat& points, const cv::Mat& mask) {
  std::vector<double> gaps;
  for (int y = 0; y < mask.rows; y += 3) {
    for (int x = 0; x + 1 < mask.cols; x += 3) {
      if (!mask.at<std::uint8_t>(y, x) || !mask.at<std::uint8_t>(y, x + 1)) continue;
      const auto &a = points.at<cv::Vec3f>(y, x), &b = points.at<cv::Vec3f>(y, x + 1);
      gaps.push_back(std::hypot(a[0] - b[0], a[1] - b[1]));
    }
  }
  if (gaps.empty()) return 0;
  std::nth_element(gaps.begin(), gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2), gaps.end());
  return gaps[gaps.size() / 2];
}

}  // namespace

GrainPoints FindGrain(const cv::Mat& points, const cv::Mat& disparity, const cv::Mat& empty_bin, const Floor& floor,
                      const Bin& bin, const GrainOptions& options) {
  GrainPoints out;
  out.mask = cv::Mat::zeros(points.size(), CV_8UC1);
  const cv::Mat rejected = NearStep(disparity, options.step_margin_px) | Spikes(disparity);

  // Candidates: over the grain floor, clear of its edges, not at a step. Rows are looked at side by side, then joined
  // in the order of the picture.
  struct Row {
    std::vector<Eigen::Vector3f> points;
    std::vector<int> columns;
    std::size_t above = 0;
  };
  std::vector<Row> rows(static_cast<std::size_t>(points.rows));
  const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
  tbb::parallel_for(tbb::blocked_range<int>(0, points.rows, 16), [&](const auto& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      Row& row = rows[static_cast<std::size_t>(y)];
      const auto* point = points.ptr<cv::Vec3f>(y);
      const auto* reject = rejected.ptr<std::uint8_t>(y);
      for (int x = 0; x < points.cols; ++x) {
        const auto& p = point[x];
        if (!std::isfinite(p[2]) || reject[x]) continue;
        const Eigen::Vector2d place(p[0], p[1]);
        if (!box.contains(place) || !IsGrainFloor(bin, place) ||
            DistanceToEdge_m(bin, place) <= options.edge_margin_m) {
          continue;
        }
        row.points.emplace_back(p[0], p[1], p[2]);
        row.columns.push_back(x);
        row.above += p[2] > bin.height_m + options.segment_distance_m;
      }
    }
  });
  std::vector<std::size_t> first(rows.size() + 1, 0);
  std::size_t above = 0;
  for (std::size_t y = 0; y < rows.size(); ++y) {
    first[y + 1] = first[y] + rows[y].points.size();
    above += rows[y].above;
  }
  if (first.back() == 0) return out;
  auto candidates = ReserveLarge<Eigen::Vector3f>(first.back());
  for (const Row& row : rows) candidates.insert(candidates.end(), row.points.begin(), row.points.end());
  out.above_share = static_cast<double>(above) / static_cast<double>(candidates.size());

  const std::vector<std::uint8_t> scene =
      empty_bin.empty() ? std::vector<std::uint8_t>(candidates.size(), 0)
                        : FindScenePoints(candidates, FinitePoints(empty_bin), options.segment_distance_m);
  std::vector<std::uint8_t> kept = PassThroughZ(candidates, static_cast<float>(-5 * options.segment_distance_m),
                                                static_cast<float>(bin.height_m + options.segment_distance_m));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rows.size(), 16), [&](const auto& range) {
    for (std::size_t y = range.begin(); y < range.end(); ++y) {
      for (std::size_t i = first[y]; i < first[y + 1]; ++i) {
        if (!kept[i]) continue;
        const Eigen::Vector3d point = candidates[i].cast<double>();
        const double height_m = point.z() - floor.HeightAt(point.head<2>());
        // A wall, a beam, a cable: scene, and not the floor.
        kept[i] = !(scene[i] && std::abs(height_m) > kFloorDistances * options.segment_distance_m);
        if (kept[i]) out.mask.at<std::uint8_t>(static_cast<int>(y), rows[y].columns[i - first[y]]) = 255;
      }
    }
  });
  DropStragglers(out.mask);
  out.points_in_world = ReserveLarge<Eigen::Vector3d>(static_cast<std::size_t>(cv::countNonZero(out.mask)));
  for (std::size_t y = 0; y < rows.size(); ++y) {
    for (std::size_t i = first[y]; i < first[y + 1]; ++i) {
      if (out.mask.at<std::uint8_t>(static_cast<int>(y), rows[y].columns[i - first[y]]) == 0) continue;
      out.points_in_world.push_back(candidates[i].cast<double>());
    }
  }
  out.spacing_m = MedianSpacing_m(points, out.mask);
  return out;
}

}  // namespace granary
