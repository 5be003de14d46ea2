// Marching squares: a cell of four pixels gives no, one or two pieces of line, whose ends lie on the cell's sides. Two
// cells share a side, so the sides' numbers join the pieces to lines.
#include "pipeline/contours.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include <opencv2/core.hpp>

#include "pipeline/plot.h"

namespace granary {
namespace {

/// A side of a cell, by the pixel it starts at: two a pixel, to the right and down.
using Side = std::size_t;

struct Crossing {
  cv::Point2f place;
  std::array<Side, 2> next{};  ///< at most one in each of the two cells that share the side
  int pieces = 0;
  bool used = false;
};

class Tracer {
 public:
  Tracer(const cv::Mat& values, double level) : values_(values), level_(level) {
    for (int y = 0; y + 1 < values.rows; ++y) {
      for (int x = 0; x + 1 < values.cols; ++x) March(x, y);
    }
  }

  [[nodiscard]] std::vector<ContourLine> Lines() {
    std::vector<ContourLine> lines;
    for (const bool open : {true, false}) {  // from the loose ends first: what remains then is closed
      for (const Side side : order_) {
        const Crossing& start = crossings_.at(side);
        if (!start.used && (!open || start.pieces == 1)) lines.push_back({Follow(side), !open});
      }
    }
    return lines;
  }

 private:
  [[nodiscard]] double Above(int x, int y) const { return values_.at<float>(y, x) - level_; }

  Side Enter(int x, int y, bool down) {
    const Side side =
        2 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(values_.cols) + static_cast<std::size_t>(x)) +
        (down ? 1 : 0);
    const auto [at, fresh] = crossings_.try_emplace(side);
    if (fresh) {
      const double first = Above(x, y), last = down ? Above(x, y + 1) : Above(x + 1, y);
      const auto share = static_cast<float>(first / (first - last));
      at->second.place = {static_cast<float>(x) + (down ? 0 : share), static_cast<float>(y) + (down ? share : 0)};
      order_.push_back(side);
    }
    return side;
  }

  void Join(Side a, Side b) {
    for (const auto& [from, to] : {std::pair(a, b), std::pair(b, a)}) {
      Crossing& crossing = crossings_.at(from);
      crossing.next.at(static_cast<std::size_t>(crossing.pieces++)) = to;
    }
  }

  void March(int x, int y) {
    const std::array<double, 4> corner{Above(x, y), Above(x + 1, y), Above(x + 1, y + 1), Above(x, y + 1)};
    for (const double value : corner) {
      if (!std::isfinite(value)) return;
    }
    std::array<Side, 4> sides{};
    std::size_t count = 0;
    const auto crosses = [&](std::size_t a, std::size_t b) { return (corner[a] >= 0) != (corner[b] >= 0); };
    if (crosses(0, 1)) sides[count++] = Enter(x, y, false);
    if (crosses(1, 2)) sides[count++] = Enter(x + 1, y, true);
    if (crosses(2, 3)) sides[count++] = Enter(x, y + 1, false);
    if (crosses(3, 0)) sides[count++] = Enter(x, y, true);
    if (count == 2) Join(sides[0], sides[1]);
    if (count == 4) {  // a saddle: the mean says which pair of corners hangs together
      const bool joined = (corner[0] + corner[1] + corner[2] + corner[3] >= 0) == (corner[0] >= 0);
      Join(sides[0], sides[joined ? 1 : 3]);
      Join(sides[2], sides[joined ? 3 : 1]);
    }
  }

  std::vector<cv::Point2f> Follow(Side side) {
    std::vector<cv::Point2f> points;
    for (bool more = true; more;) {
      Crossing& crossing = crossings_.at(side);
      crossing.used = true;
      points.push_back(crossing.place);
      more = false;
      for (int i = 0; i < crossing.pieces && !more; ++i) {
        const Side next = crossing.next.at(static_cast<std::size_t>(i));
        if (crossings_.at(next).used) continue;
        side = next;
        more = true;
      }
    }
    return points;
  }

  const cv::Mat& values_;
  double level_;
  std::unordered_map<Side, Crossing> crossings_;
  std::vector<Side> order_;  ///< as found, so that the lines do not depend on the table
};

}  // namespace

std::vector<ContourLine> TraceContours(const cv::Mat& values, double level) {
  if (values.type() != CV_32FC1) throw std::invalid_argument("contours: one float channel is wanted");
  return Tracer(values, level).Lines();
}

ContourLevels ChooseContourLevels(double low, double high, int count, double least_interval) {
  ContourLevels out;
  if (!(high > low) || count < 1) return out;
  const double rough = std::max((high - low) / count, least_interval);
  out.interval = RoundStep(rough);
  if (high - low < out.interval) return out;
  for (double n = std::ceil(low / out.interval); n * out.interval <= high; ++n) out.levels.push_back(n * out.interval);
  return out;
}

}  // namespace granary
