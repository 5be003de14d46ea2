// One level, since the search at half size costs an eighth of the full one. All tiles get windows of one width, so that
// path costs keep their vectors; a tile that would need a wider one is centred on its median.
#include "pipeline/stereo/coarse.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace granary {

namespace {

constexpr int kTile_px = DisparityTiles::kTile_px;
constexpr int kHalo_px = 16;             // around a tile, in full-size pixels: a surface may begin there
constexpr int kMargin_px = 8;            // beyond what is seen: a pixel of the half-size search is two, and heaps curve
constexpr double kSeenShare = 0.05;      // of a tile's pixels that must match for the tile to count as seen
constexpr double kServedTiles = 0.98;    // share of the tiles whose whole window the common width covers
constexpr double kWorthwhile = 2.0 / 3;  // of the full range

// What a tile needs, in full-size disparities.
struct Span {
  float low = 0, high = 0, middle = 0;
  bool seen = false;
};

cv::Mat HalfSize(const cv::Mat& picture, int interpolation) {
  cv::Mat half;
  if (!picture.empty()) {
    cv::resize(picture, half, {(picture.cols + 1) / 2, (picture.rows + 1) / 2}, 0, 0, interpolation);
  }
  return half;
}

Span SpanOf(const cv::Mat& half_disparity, cv::Rect tile) {
  std::vector<float> values;
  for (int y = tile.y; y < tile.y + tile.height; ++y) {
    for (int x = tile.x; x < tile.x + tile.width; ++x) {
      const float d = half_disparity.at<float>(y, x);
      if (std::isfinite(d)) values.push_back(2 * d);
    }
  }
  if (static_cast<double>(values.size()) < kSeenShare * tile.area()) return {};
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const float median = *middle;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return {*low, *high, median, true};
}

// Unseen tiles take the union of what their neighbours have, ring by ring from the seen ones.
bool FillUnseen(std::vector<Span>& spans, int columns, int rows) {
  for (bool all = false; !all;) {
    all = true;
    bool grew = false;
    const std::vector<Span> before = spans;
    for (int v = 0; v < rows; ++v) {
      for (int u = 0; u < columns; ++u) {
        Span& span = spans[static_cast<std::size_t>(v) * columns + u];
        if (span.seen) continue;
        for (int j = std::max(0, v - 1); j <= std::min(rows - 1, v + 1); ++j) {
          for (int i = std::max(0, u - 1); i <= std::min(columns - 1, u + 1); ++i) {
            const Span& near = before[static_cast<std::size_t>(j) * columns + i];
            if (!near.seen) continue;
            span.low = span.seen ? std::min(span.low, near.low) : near.low;
            span.high = span.seen ? std::max(span.high, near.high) : near.high;
            span.middle = (span.low + span.high) / 2;
            span.seen = grew = true;
          }
        }
        all = all && span.seen;
      }
    }
    if (!all && !grew) return false;
  }
  return true;
}

}  // namespace

std::optional<DisparityTiles> ProposeTiles(const GreyPair& pair, DisparityRange range, const StereoOptions& options) {
  GreyPair half{HalfSize(pair.left, cv::INTER_AREA),
                HalfSize(pair.right, cv::INTER_AREA),
                {HalfSize(pair.usable.left, cv::INTER_NEAREST), HalfSize(pair.usable.right, cv::INTER_NEAREST)},
                pair.levels_of_255};
  StereoOptions coarse = options;
  coarse.speckle_area_px = std::max(1, options.speckle_area_px / 4);
  const int first = static_cast<int>(std::floor(range.min_px / 2.0));
  const int last = static_cast<int>(std::ceil((range.min_px + range.count - 1) / 2.0));
  SearchBuffers memory;
  const cv::Mat disparity = SearchDisparity(half, {first, last - first + 1}, coarse, nullptr, memory);

  const int columns = (pair.left.cols + kTile_px - 1) / kTile_px, rows = (pair.left.rows + kTile_px - 1) / kTile_px;
  const cv::Rect picture({0, 0}, disparity.size());
  std::vector<Span> spans;
  for (int v = 0; v < rows; ++v) {
    for (int u = 0; u < columns; ++u) {
      const int side = (kTile_px + 2 * kHalo_px) / 2;
      spans.push_back(SpanOf(
          disparity, cv::Rect((u * kTile_px - kHalo_px) / 2, (v * kTile_px - kHalo_px) / 2, side, side) & picture));
    }
  }
  if (!FillUnseen(spans, columns, rows)) return std::nullopt;

  std::vector<double> needs;
  for (const Span& span : spans) needs.push_back(span.high - span.low + 2 * kMargin_px + 1);
  std::sort(needs.begin(), needs.end());
  const double need = needs[static_cast<std::size_t>(kServedTiles * static_cast<double>(needs.size() - 1))];
  DisparityTiles tiles;
  tiles.count = static_cast<int>(std::ceil(need / 64)) * 64;
  if (tiles.count > kWorthwhile * range.count) return std::nullopt;
  tiles.first.create(rows, columns, CV_32SC1);
  for (int v = 0; v < rows; ++v) {
    for (int u = 0; u < columns; ++u) {
      const Span& span = spans[static_cast<std::size_t>(v) * columns + u];
      const bool fits = span.high - span.low + 2 * kMargin_px < tiles.count;
      const double centre = fits ? (span.low + span.high) / 2 : span.middle;
      const int begin = static_cast<int>(std::lround(centre - tiles.count / 2.0)) - range.min_px;
      tiles.first.at<int>(v, u) = std::clamp(begin, 0, range.count - tiles.count);
    }
  }
  return tiles;
}

}  // namespace granary
