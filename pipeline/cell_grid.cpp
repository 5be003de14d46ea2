// Cells are cubes in a hash table. Every 16 points of a cell share a box; in a crowded cell (a distance far above the
// spacing) they follow a Morton curve, so that the boxes are compact and a few of them decide.
#include "pipeline/cell_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <utility>

#include "pipeline/large_pages.h"

namespace granary {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr double kFineCell_m = 1e-3;  // no need for less, however small the distance
constexpr double kFinestCell_m = 1e-6;
constexpr int kSubBits = 3;            // a cell is ordered by 8 × 8 × 8 sub-cells
constexpr std::size_t kCrowded = 256;  // points in a cell from which its order pays
constexpr std::size_t kSubCells = std::size_t{1} << (3 * kSubBits);

/// Spreads the bits of a number below 8 three apart.
constexpr std::uint32_t Spread(std::uint32_t v) { return (v & 1U) | ((v & 2U) << 2) | ((v & 4U) << 4); }

/// A typical distance from one point to the next in the cloud's own order, m; 0 for a cloud of fewer than two points.
double TypicalStep(std::span<const Eigen::Vector3f> points) {
  std::vector<float> squared;
  const std::size_t stride = points.size() / 1000 + 1;
  for (std::size_t i = 1; i < points.size(); i += stride) {
    const float gap = (points[i] - points[i - 1]).squaredNorm();
    if (std::isfinite(gap)) squared.push_back(gap);
  }
  if (squared.empty()) return 0;
  const auto middle = squared.begin() + static_cast<std::ptrdiff_t>(squared.size() / 2);
  std::nth_element(squared.begin(), middle, squared.end());
  return std::sqrt(static_cast<double>(*middle));
}

}  // namespace

CellGrid::CellGrid(std::span<const Eigen::Vector3f> points, double distance_m)
    : distance_squared_(distance_m * distance_m) {
  // A shade more than the distance covers the rounding of the division into cells. Where the points are sparse, larger
  // cells are cheaper than many that hold one point; but in a cloud without order the step says nothing.
  const double sparse = std::min(4 * TypicalStep(points), std::max(8 * distance_m, kFineCell_m));
  const double side = std::max({distance_m * (1 + 1e-6), sparse, kFinestCell_m});
  cells_per_m_ = 1 / side;

  table_.assign(1024, kNone);
  const std::size_t count = points.size();
  auto number = MakeLarge<std::uint32_t>(count);
  std::vector<std::uint32_t> population;
  Cell last{};
  std::uint32_t last_number = kNone;
  for (std::size_t i = 0; i < count; ++i) {
    if (!points[i].allFinite()) {
      number[i] = kNone;
      continue;
    }
    const Cell cell = CellOf(points[i]);
    if (last_number == kNone || !(cell == last)) {
      last = cell;
      last_number = Enter(cell);
      if (last_number == population.size()) population.push_back(0);
    }
    ++population[last_number];
    number[i] = last_number;
  }

  // A stable counting sort by cell.
  cell_start_.reserve(population.size() + 1);
  std::uint32_t start = 0;
  for (const std::uint32_t in_cell : population) {
    cell_start_.push_back(start);
    start += in_cell;
  }
  cell_start_.push_back(start);
  std::vector<std::uint32_t> next(cell_start_.begin(), cell_start_.end() - 1);
  points_ = MakeLarge<Eigen::Vector3f>(start);
  for (std::size_t i = 0; i < count; ++i) {
    if (number[i] != kNone) points_[next[number[i]]++] = points[i];
  }
  for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
    if (population[cell] > kCrowded) OrderCell(cell);
  }
  MakeBoxes();
}

/// Orders the points of one cell along a Morton curve, so that blocks of them are compact.
void CellGrid::OrderCell(std::size_t cell) {
  const std::span<Eigen::Vector3f> inside(&points_[cell_start_[cell]], cell_start_[cell + 1] - cell_start_[cell]);
  const std::vector<Eigen::Vector3f> before(inside.begin(), inside.end());
  std::array<std::uint32_t, kSubCells + 1> start{};
  for (const auto& point : before) ++start[SubCellOf(point, cells_[cell]) + 1];
  for (std::size_t sub = 0; sub < kSubCells; ++sub) start[sub + 1] += start[sub];
  for (const auto& point : before) inside[start[SubCellOf(point, cells_[cell])]++] = point;
}

void CellGrid::MakeBoxes() {
  cell_box_.reserve(cells_.size());
  block_start_.reserve(cells_.size());
  block_box_ = ReserveLarge<Box>(points_.size() / kBlock + cells_.size());
  for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
    block_start_.push_back(static_cast<std::uint32_t>(block_box_.size()));
    for (std::size_t begin = cell_start_[cell]; begin < cell_start_[cell + 1]; begin += kBlock) {
      const std::size_t end = std::min<std::size_t>(begin + kBlock, cell_start_[cell + 1]);
      Box box{points_[begin], points_[begin]};
      for (std::size_t i = begin + 1; i < end; ++i) {
        box.low = box.low.min(points_[i].array());
        box.high = box.high.max(points_[i].array());
      }
      block_box_.push_back(box);
    }
    Box whole = block_box_[block_start_[cell]];
    for (std::size_t block = block_start_[cell] + 1; block < block_box_.size(); ++block) {
      whole.low = whole.low.min(block_box_[block].low);
      whole.high = whole.high.max(block_box_[block].high);
    }
    cell_box_.push_back(whole);
  }
}

std::uint32_t CellGrid::SubCellOf(const Eigen::Vector3f& point, const Cell& cell) const {
  constexpr int kLast = (1 << kSubBits) - 1;
  const auto along = [&](float coordinate, std::int32_t of_cell) {
    const double within = std::clamp(static_cast<double>(coordinate) * cells_per_m_ - of_cell, 0.0, 1.0);
    return Spread(static_cast<std::uint32_t>(std::min(kLast, static_cast<int>(within * (kLast + 1)))));
  };
  return along(point.x(), cell.x) | along(point.y(), cell.y) << 1 | along(point.z(), cell.z) << 2;
}

std::uint32_t CellGrid::NumberOf(const Cell& cell) const {
  const std::size_t mask = table_.size() - 1;
  for (std::size_t slot = cell.Hash() & mask;; slot = (slot + 1) & mask) {
    const std::uint32_t number = table_[slot];
    if (number == kNone || cells_[number] == cell) return number;
  }
}

std::uint32_t CellGrid::Enter(const Cell& cell) {
  const std::uint32_t known = NumberOf(cell);
  if (known != kNone) return known;
  if (2 * (cells_.size() + 1) > table_.size()) GrowTable();
  cells_.push_back(cell);
  const auto number = static_cast<std::uint32_t>(cells_.size() - 1);
  const std::size_t mask = table_.size() - 1;
  std::size_t slot = cell.Hash() & mask;
  while (table_[slot] != kNone) slot = (slot + 1) & mask;
  table_[slot] = number;
  return number;
}

void CellGrid::GrowTable() {
  table_.assign(4 * table_.size(), kNone);
  const std::size_t mask = table_.size() - 1;
  for (std::uint32_t number = 0; number < cells_.size(); ++number) {
    std::size_t slot = cells_[number].Hash() & mask;
    while (table_[slot] != kNone) slot = (slot + 1) & mask;
    table_[slot] = number;
  }
}

void CellGrid::FindNeighbours(const Cell& centre, std::vector<std::uint32_t>& numbers) const {
  // by the number of axes on which they differ: itself, faces, edges, corners
  static constexpr auto kSteps = [] {
    std::array<std::array<std::int32_t, 3>, 27> steps{};
    std::size_t next = 0;
    for (int differing = 0; differing <= 3; ++differing) {
      for (int x = -1; x <= 1; ++x) {
        for (int y = -1; y <= 1; ++y) {
          for (int z = -1; z <= 1; ++z) {
            if (x * x + y * y + z * z == differing) steps[next++] = {x, y, z};
          }
        }
      }
    }
    return steps;
  }();
  numbers.clear();
  if (cells_.empty()) return;
  for (const auto& step : kSteps) {
    const std::uint32_t number = NumberOf({centre.x + step[0], centre.y + step[1], centre.z + step[2]});
    if (number != kNone) numbers.push_back(number);
  }
}

const Eigen::Vector3f* CellGrid::FindWithin(const Eigen::Array3d& p, std::span<const std::uint32_t> numbers) const {
  for (const std::uint32_t cell : numbers) {
    if (cell_box_[cell].NearestSquared(p) > distance_squared_) continue;
    const std::size_t begin = cell_start_[cell], end = cell_start_[cell + 1];
    if (cell_box_[cell].FurthestSquared(p) <= distance_squared_) return &points_[begin];
    const Box* box = &block_box_[block_start_[cell]];
    for (std::size_t block = begin; block < end; block += kBlock, ++box) {
      if (box->NearestSquared(p) > distance_squared_) continue;
      for (std::size_t i = block; i < std::min(block + kBlock, end); ++i) {
        if (IsWithin(p, points_[i])) return &points_[i];
      }
    }
  }
  return nullptr;
}

}  // namespace granary
