// Two sweeps, one down and one up, follow four paths each: the three from the row before and the one along the row.
// Where a sweep comes first it keeps its sums, where it comes second it adds its own and picks the winners; they meet
// in the middle and then walk over each other's rows. When the sums to be kept exceed the budget, each half is cut into
// bands: a sweep follows its paths to the last band of its half, and runs over the earlier ones again, from where it
// stood, when their turn comes.
// A row may be a segment behind the row before it, so that several threads can share a sweep. Everything is whole
// numbers, and no result depends on who was first.
#include "pipeline/stereo/aggregate.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <thread>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>
#include <tbb/task_arena.h>

#include <opencv2/core.hpp>

#include "pipeline/stereo/path_kernels.h"
#include "pipeline/stereo/sweep.h"
#include "pipeline/stereo/winner_kernels.h"

namespace granary {

namespace {

constexpr int kPathsInAll = 8;

void Prefetch(const void* data, std::size_t bytes) {
  for (std::size_t at = 0; at < bytes; at += 64) __builtin_prefetch(static_cast<const char*>(data) + at);
}

static_assert(DisparityTiles::kTile_px == kSegment);

enum class Visit { kPathsOnly, kKeepSums, kPickWinners };

template <typename Cost>
class Aggregation {
 public:
  Aggregation(const CensusImage& left, const CensusImage& right, DisparityRange range, const AggregateOptions& options,
              Winners& winners)
      : left_(left), right_(right), range_(range), options_(options), winners_(winners) {
    const int searched = options.tiles == nullptr ? range.count : options.tiles->count;
    stride_ = (searched + kLaneMultiple - 1) / kLaneMultiple * kLaneMultiple;
    chunks_ = stride_ / kChunk;
    offset_ = -range.min_px - (range.count - 1);
    padding_.Reserve(stride_);
    tags_.Reserve(stride_);
    for (int e = 0; e < stride_; ++e) {
      const bool real = e < searched;
      padding_.data()[e] = real ? Cost{0} : std::numeric_limits<Cost>::max();
      tags_.data()[e] = real ? static_cast<Key<Cost>>(kChunk - 1 - e % kChunk) : std::numeric_limits<Key<Cost>>::max();
    }
    constexpr int kMostSum = static_cast<int>(kNoSum) - 1;
    for (int sum = 0; sum <= kPathsInAll * (options.census_bits + options.p2); ++sum) {
      const double limit = std::min<double>(sum * (1.0 + options.uniqueness), kMostSum);
      near_.push_back(static_cast<Key<Cost>>(static_cast<Key<Cost>>(limit) << kTagBits | (kChunk - 1)));
    }
    winners_.left_index.create(left.height, left.width, CV_16SC1);
    winners_.right_index.create(left.height, left.width, CV_16SC1);
    winners_.subpixel.create(left.height, left.width, CV_32FC1);
    winners_.unique.create(left.height, left.width, CV_8UC1);
  }

  void Run(AggregateBuffers& buffers);

 private:
  static constexpr Key<Cost> kNoSum = std::numeric_limits<Key<Cost>>::max() >> kTagBits;

  struct Sweep {
    Direction way;
    PathSlots<Cost> slots;
  };
  // What one thread needs for one row, and where it stands in it.
  struct Scratch {
    RawArray<std::uint8_t> cost, prepared;
    RawArray<Cost> row_path, sums;
    RawArray<Key<Cost>> right;
    Key<Cost>* keys = nullptr;  // the same for both rows of a pair: it stays in the first cache
    std::vector<Cost> p2[kPaths + 1];
    int j = 0, y = 0;
    CostRow row;
    Cost row_least = 0;
    Cost* kept = nullptr;
    int segment = 0, x = 0;      // counted in columns
    int begin = 0, count = 0;    // pixels of the segment in the order of the sweep
    int row_place[kPaths] = {};  // of the row's first pixel
    int first_lane = 0;
    bool moves = false;  // whether neighbours of the segment have other lanes
  };

  // Rows j0 … j1 − 1 of a sweep; `kept` holds the sums of those rows, the topmost one first.
  struct Stretch {
    Sweep* sweep;
    int j0, j1;
    Visit visit;
    Cost* kept;
    std::atomic<int> next{0};                  // row to be taken by a thread
    std::vector<std::atomic<int>> progress{};  // pixels done, row by row
    Stretch(Sweep& way, int from, int to, Visit what, Cost* sums)
        : sweep(&way), j0(from), j1(to), visit(what), kept(sums), progress(to - from) {}
  };

  void RunBoth(Stretch forward, Stretch backward);
  void Work(Stretch& stretch) const;
  void BeginRow(const Stretch& stretch, int j, Scratch& scratch) const;
  void RowPair(Stretch& stretch, int j, int rows, Scratch (&scratch)[2]) const;
  void BeginSegment(const Stretch& stretch, int s, Scratch& scratch) const;
  void MoveLanes(const Sweep& sweep, Scratch& scratch) const;
  PathRun<Cost> FirstRun(const Stretch& stretch, Scratch& scratch, int at) const;
  void Pick(const Stretch& stretch, Scratch& scratch) const;

  [[nodiscard]] std::size_t RowSize() const { return static_cast<std::size_t>(left_.width) * stride_; }
  [[nodiscard]] std::size_t RightWidth() const { return static_cast<std::size_t>(left_.width) + 2 * kRightMargin; }
  [[nodiscard]] int Segments() const { return (left_.width + kSegment - 1) / kSegment; }
  /// Of the pixels of row y in a segment, counted in columns.
  [[nodiscard]] int FirstLane(int y, int segment) const {
    if (options_.tiles == nullptr) return 0;
    return range_.count - stride_ - options_.tiles->first.at<int>(y / DisparityTiles::kTile_px, segment);
  }

  const CensusImage& left_;
  const CensusImage& right_;
  DisparityRange range_;
  AggregateOptions options_;
  int stride_ = 0, chunks_ = 0, offset_ = 0;
  RawArray<Cost> padding_;
  RawArray<Key<Cost>> tags_;
  std::vector<Key<Cost>> near_;
  Winners& winners_;  // each row belongs to one thread
};

template <typename Cost>
void Aggregation<Cost>::Run(AggregateBuffers& buffers) {
  const int width = left_.width, height = left_.height;
  const int own[2] = {height / 2, height - height / 2};  // rows on which a sweep comes first
  const std::size_t budget_rows = std::max<std::size_t>(2, options_.sums_budget / (RowSize() * sizeof(Cost)));
  const int bands = static_cast<int>((height + budget_rows - 1) / budget_rows);
  const auto edge = [&](int way, int band) { return static_cast<int>(std::int64_t{own[way]} * band / bands); };
  std::size_t band_rows = 0;
  for (int band = 0; band < bands; ++band) {
    for (int way = 0; way < 2; ++way) {
      band_rows = std::max<std::size_t>(band_rows, edge(way, band + 1) - edge(way, band));
    }
  }
  buffers.sums.Reserve(2 * band_rows * RowSize() * sizeof(Cost));
  Cost* kept[2];
  for (int way = 0; way < 2; ++way) {
    kept[way] = reinterpret_cast<Cost*>(buffers.sums.data()) + way * band_rows * RowSize();
  }

  // Per way: where it stands, where it stood at the beginning of each band but the first and the last, and a copy to
  // run over a band again.
  const int ring = PathSlots<Cost>::Ring(width);
  const std::size_t block = PathSlots<Cost>::Count(ring, stride_);
  const int blocks = bands == 1 ? 1 : bands;
  buffers.paths.Reserve(2 * blocks * block * sizeof(Cost));
  const auto slots = [&](int way, int i) {
    Cost* base = reinterpret_cast<Cost*>(buffers.paths.data());
    return PathSlots<Cost>{ring, stride_, base + (static_cast<std::size_t>(way) * blocks + i) * block};
  };
  Sweep sweeps[2], again[2];
  for (int way = 0; way < 2; ++way) {
    const Direction direction{way == 0, width, height};
    sweeps[way] = {direction, slots(way, 0)};
    sweeps[way].slots.ClearAll();
    if (bands > 1) again[way] = {direction, slots(way, 1)};
  }
  const auto checkpoint = [&](int way, int band) { return slots(way, 1 + band); };  // 1 ≤ band ≤ bands − 2

  for (int band = 0; band + 1 < bands; ++band) {
    if (band > 0) {
      for (int way = 0; way < 2; ++way) checkpoint(way, band).CopyFrom(sweeps[way].slots);
    }
    RunBoth({sweeps[0], edge(0, band), edge(0, band + 1), Visit::kPathsOnly, nullptr},
            {sweeps[1], edge(1, band), edge(1, band + 1), Visit::kPathsOnly, nullptr});
  }
  for (int band = bands - 1; band >= 0; --band) {
    Sweep* first = sweeps;
    if (band < bands - 1) {
      first = again;
      for (int way = 0; way < 2; ++way) {
        if (band > 0) {
          again[way].slots.CopyFrom(checkpoint(way, band));
        } else {
          again[way].slots.ClearAll();
        }
      }
    }
    RunBoth({first[0], edge(0, band), edge(0, band + 1), Visit::kKeepSums, kept[0]},
            {first[1], edge(1, band), edge(1, band + 1), Visit::kKeepSums, kept[1]});
    RunBoth({sweeps[0], height - edge(1, band + 1), height - edge(1, band), Visit::kPickWinners, kept[1]},
            {sweeps[1], height - edge(0, band + 1), height - edge(0, band), Visit::kPickWinners, kept[0]});
  }
}

template <typename Cost>
void Aggregation<Cost>::RunBoth(Stretch forward, Stretch backward) {
  const int workers = std::clamp(tbb::this_task_arena::max_concurrency() / 2, 1, kMaxRowsInWork);
  tbb::parallel_for(
      tbb::blocked_range<int>(0, 2 * workers, 1),
      [&](const tbb::blocked_range<int>& tasks) {
        for (int task = tasks.begin(); task < tasks.end(); ++task) Work(task % 2 == 0 ? forward : backward);
      },
      tbb::simple_partitioner());
}

template <typename Cost>
void Aggregation<Cost>::Work(Stretch& stretch) const {
  Scratch scratch[2];
  RawArray<Key<Cost>> keys;
  if (stretch.visit == Visit::kPickWinners) {
    keys.Reserve(static_cast<std::size_t>(kSegment) * chunks_ * kKeyStride);
    std::fill_n(keys.data(), keys.capacity(), std::numeric_limits<Key<Cost>>::max());
  }
  for (Scratch& one : scratch) {
    one.cost.Reserve(static_cast<std::size_t>(kSegment) * stride_);
    one.prepared.Reserve(PreparedBytes(left_.width, range_.count, left_.bytes));
    std::fill_n(one.prepared.data(), one.prepared.capacity(), std::uint8_t{0});
    one.row_path.Reserve(stride_);
    if (stretch.visit != Visit::kPickWinners) continue;
    one.sums.Reserve(static_cast<std::size_t>(kSegment) * stride_);
    one.keys = keys.data();
    one.right.Reserve(2 * RightWidth());
  }
  // Rows are taken in order, so the row before any that is waited for is in the hands of a running thread.
  const int rows = stretch.j1 - stretch.j0;
  for (int row = stretch.next.fetch_add(2); row < rows; row = stretch.next.fetch_add(2)) {
    RowPair(stretch, stretch.j0 + row, std::min(2, rows - row), scratch);
  }
}

template <typename Cost>
void Aggregation<Cost>::BeginRow(const Stretch& stretch, int j, Scratch& scratch) const {
  const Sweep& sweep = *stretch.sweep;
  const Direction& way = sweep.way;
  scratch.j = j;
  scratch.y = way.Row(j);
  CostRow& row = scratch.row;
  row.left = left_.Row(scratch.y);
  row.right = scratch.prepared.data();
  row.right_stride = PreparedPlaneStride(way.width, range_.count);
  row.bytes = left_.bytes;
  row.width = way.width;
  row.lanes = range_.count;
  row.stride = stride_;
  row.offset = offset_;
  row.outside = static_cast<std::uint8_t>(options_.census_bits);
  PrepareRight(right_.Row(scratch.y), row, scratch.prepared.data());
  if (stretch.visit == Visit::kPickWinners) {
    std::fill_n(scratch.right.data(), RightWidth(), kNoSum);
    std::fill_n(scratch.right.data() + RightWidth(), RightWidth(), Key<Cost>{0});
  }
  if (options_.guide != nullptr || scratch.p2[0].empty()) {
    Penalties(options_, way, j, 1, 0, scratch.p2[0]);
    Penalties(options_, way, j, 1, 1, scratch.p2[1]);
    Penalties(options_, way, j, 1, -1, scratch.p2[2]);
    Penalties(options_, way, j, 0, 1, scratch.p2[3]);
  }
  for (int k = 0; k < kPaths; ++k) scratch.row_place[k] = sweep.slots.Place(k, 0, j);
  // Paths that come in from the side.
  sweep.slots.Clear(1, scratch.row_place[1]);
  sweep.slots.Clear(2, sweep.slots.Place(2, way.width - 1, j));
  std::fill_n(scratch.row_path.data(), stride_, Cost{0});
  scratch.row_least = 0;
  if (stretch.kept != nullptr) {
    const int top_row = way.forward ? way.Row(stretch.j0) : way.Row(stretch.j1 - 1);
    scratch.kept = stretch.kept + (scratch.y - top_row) * RowSize();
  }
}

template <typename Cost>
void Aggregation<Cost>::RowPair(Stretch& stretch, int j, int rows, Scratch (&scratch)[2]) const {
  const Direction& way = stretch.sweep->way;
  for (int r = 0; r < rows; ++r) BeginRow(stretch, j + r, scratch[r]);
  std::atomic<int>* done = &stretch.progress[j - stretch.j0];
  // The second row is a segment behind the first one, on which it stands.
  for (int s = 0; s < Segments() + rows - 1; ++s) {
    bool moves = false;
    for (int r = 0; r < rows; ++r) {
      BeginSegment(stretch, s - r, scratch[r]);
      if (scratch[r].count == 0) continue;
      if (r == 0 && j > stretch.j0) {
        const int wanted =
            std::min(way.width, scratch[0].begin + scratch[0].count + 1);  // one path is from the pixel after
        while (done[-1].load(std::memory_order_acquire) < wanted) std::this_thread::yield();
      }
      ComputeCosts(scratch[r].row, way.Column(scratch[r].begin), way.forward ? 1 : -1, scratch[r].count,
                   scratch[r].first_lane, scratch[r].cost.data());
      moves = moves || scratch[r].moves;
    }
    PathRun<Cost> runs[2];
    const auto whole = [&](int r) {
      runs[r] = FirstRun(stretch, scratch[r], 0);
      return runs[r].count == scratch[r].count;
    };
    if (!moves && rows == 2 && scratch[0].count > 0 && scratch[1].count > 0 && whole(0) && whole(1)) {
      StepPaths(runs[0], &runs[1]);
    } else {
      for (int r = 0; r < rows; ++r) {
        if (scratch[r].moves) MoveLanes(*stretch.sweep, scratch[r]);
        for (int at = 0; at < scratch[r].count; at += runs[r].count) {
          runs[r] = FirstRun(stretch, scratch[r], at);
          StepPaths(runs[r], nullptr);
        }
      }
    }
    for (int r = 0; r < rows; ++r) {
      if (scratch[r].count == 0) continue;
      done[r].store(scratch[r].begin + scratch[r].count, std::memory_order_release);
      if (stretch.visit == Visit::kPickWinners) Pick(stretch, scratch[r]);
    }
  }
  if (stretch.visit != Visit::kPickWinners) return;
  for (int r = 0; r < rows; ++r) {
    const Key<Cost>* sum = scratch[r].right.data() + kRightMargin;
    const Key<Cost>* index = sum + RightWidth();
    std::int16_t* out = winners_.right_index.ptr<std::int16_t>(scratch[r].y);
    for (int x = 0; x < way.width; ++x) {
      out[x] = sum[x] == kNoSum ? std::int16_t{-1} : static_cast<std::int16_t>(index[x]);
    }
  }
}

// Segments are the same columns for both directions.
template <typename Cost>
void Aggregation<Cost>::BeginSegment(const Stretch& stretch, int s, Scratch& scratch) const {
  scratch.count = 0;
  scratch.moves = false;
  if (s < 0 || s >= Segments()) return;
  const Direction& way = stretch.sweep->way;
  scratch.segment = way.forward ? s : Segments() - 1 - s;
  scratch.x = scratch.segment * kSegment;
  scratch.count = std::min(kSegment, way.width - scratch.x);
  scratch.begin = way.forward ? scratch.x : way.Column(scratch.x + scratch.count - 1);
  scratch.first_lane = FirstLane(scratch.y, scratch.segment);
  if (options_.tiles != nullptr) {
    const int before = scratch.j > 0 ? way.Row(scratch.j - 1) : scratch.y;
    for (int near = std::max(0, scratch.segment - 1); near <= std::min(Segments() - 1, scratch.segment + 1); ++near) {
      scratch.moves = scratch.moves || FirstLane(before, near) != scratch.first_lane ||
                      FirstLane(scratch.y, near) != scratch.first_lane;
    }
  }
  if (stretch.visit == Visit::kPickWinners) {
    Prefetch(scratch.kept + static_cast<std::size_t>(scratch.x) * stride_,
             static_cast<std::size_t>(scratch.count) * stride_ * sizeof(Cost));
  }
}

// Where the pixel before searched other disparities, its path costs move to the lanes of this one's; what it did not
// search costs without limit.
template <typename Cost>
void Aggregation<Cost>::MoveLanes(const Sweep& sweep, Scratch& scratch) const {
  const Direction& way = sweep.way;
  const auto move = [&](Cost* slot, int from_lane) {
    const int shift = scratch.first_lane - from_lane, kept = std::max(0, stride_ - std::abs(shift));
    constexpr Cost kNothing = std::numeric_limits<Cost>::max();
    if (shift == 0) return;
    if (shift > 0) {
      std::copy(slot + stride_ - kept, slot + stride_, slot);
      std::fill(slot + kept, slot + stride_, kNothing);
    } else {
      std::copy_backward(slot, slot + kept, slot + stride_);
      std::fill(slot, slot + stride_ - kept, kNothing);
    }
  };
  const auto lane_of = [&](int i, int y) { return FirstLane(y, way.Column(i) / kSegment); };
  if (scratch.begin > 0) move(scratch.row_path.data(), lane_of(scratch.begin - 1, scratch.y));
  if (scratch.j == 0) return;
  const int before = way.Row(scratch.j - 1);
  for (int k = 0; k < kPaths; ++k) {
    const int from = k == 0 ? 0 : k == 1 ? -1 : 1;
    for (int i = scratch.begin; i < scratch.begin + scratch.count; ++i) {
      if (i + from < 0 || i + from >= way.width) continue;
      move(sweep.slots.Path(k) + static_cast<std::size_t>(sweep.slots.Place(k, i, scratch.j)) * stride_,
           lane_of(i + from, before));
    }
  }
}

// Of a segment, what follows its first `at` pixels up to where a ring of slots ends.
template <typename Cost>
PathRun<Cost> Aggregation<Cost>::FirstRun(const Stretch& stretch, Scratch& scratch, int at) const {
  const Sweep& sweep = *stretch.sweep;
  const Direction& way = sweep.way;
  PathRun<Cost> run;
  run.stride = stride_;
  run.padding = padding_.data();
  run.p1 = static_cast<Cost>(options_.p1);
  run.row_path = scratch.row_path.data();
  run.row_least = &scratch.row_least;
  run.count = scratch.count - at;
  for (int k = 0; k < kPaths; ++k) {
    const int beyond = scratch.row_place[k] + scratch.begin + at;
    const int place = beyond < sweep.slots.ring ? beyond : beyond - sweep.slots.ring;
    run.count = std::min(run.count, sweep.slots.ring - place);
    run.paths[k] = sweep.slots.Path(k) + static_cast<std::size_t>(place) * stride_;
    run.least[k] = sweep.slots.Least(k) + place;
  }
  for (int k = 0; k <= kPaths; ++k) run.p2[k] = scratch.p2[k].data() + scratch.begin + at;
  run.cost = scratch.cost.data() + static_cast<std::size_t>(at) * stride_;
  if (stretch.visit == Visit::kKeepSums) {
    run.sums = scratch.kept + static_cast<std::size_t>(way.Column(scratch.begin + at)) * stride_;
    run.sums_step = way.forward ? stride_ : -stride_;
  } else if (stretch.visit == Visit::kPickWinners) {
    run.sums = scratch.sums.data() + static_cast<std::size_t>(at) * stride_;
    run.sums_step = stride_;
  }
  return run;
}

template <typename Cost>
void Aggregation<Cost>::Pick(const Stretch& stretch, Scratch& scratch) const {
  const Direction& way = stretch.sweep->way;
  WinnerRun<Cost> run;
  run.x = scratch.x;
  run.count = scratch.count;
  run.width = way.width;
  run.lanes = range_.count;
  run.stride = stride_;
  run.offset = offset_;
  run.first_lane = scratch.first_lane;
  const std::ptrdiff_t step = way.forward ? stride_ : -stride_;
  const std::size_t leftmost = way.forward ? 0 : static_cast<std::size_t>(scratch.count - 1) * stride_;
  run.cost = scratch.cost.data() + leftmost;
  run.sums[0] = scratch.kept + static_cast<std::size_t>(scratch.x) * stride_;
  run.sums[1] = scratch.sums.data() + leftmost;
  run.step[0] = run.step[2] = step;
  run.step[1] = stride_;
  run.tags = tags_.data();
  run.near = near_.data();
  run.keys = scratch.keys;
  run.left_index = winners_.left_index.ptr<std::int16_t>(scratch.y) + scratch.x;
  run.subpixel = winners_.subpixel.ptr<float>(scratch.y) + scratch.x;
  run.unique = winners_.unique.ptr<std::uint8_t>(scratch.y) + scratch.x;
  run.right_sum = scratch.right.data() + kRightMargin;
  run.right_index = run.right_sum + RightWidth();
  SelectWinners(run);
}

// Whether bytes hold every path cost, the sums of four paths without C, and 16-bit keys the sums of all eight.
bool FitsBytes(const AggregateOptions& options) {
  const int path = options.census_bits + options.p2;
  return path <= 254 && 4 * options.p2 <= 255 && kPathsInAll * path < (1 << (16 - kTagBits)) - 1;
}

}  // namespace

void FindWinners(const CensusImage& left, const CensusImage& right, DisparityRange range,
                 const AggregateOptions& options, AggregateBuffers& buffers, Winners& winners) {
  if (left.width != right.width || left.height != right.height || left.bytes != right.bytes || left.width < 1 ||
      left.height < 1) {
    throw std::invalid_argument("aggregation: the pictures must have one size and not be empty");
  }
  if (range.count < 1 || range.count > std::numeric_limits<std::int16_t>::max()) {
    throw std::invalid_argument("aggregation: the number of disparities must be 1 to 32767");
  }
  if (options.p1 < 0 || options.p2 < options.p1 || options.p2 > 4000) {
    throw std::invalid_argument("aggregation: penalties must be 0 <= P1 <= P2 <= 4000");
  }
  if (options.tiles != nullptr) {
    constexpr int kTile = DisparityTiles::kTile_px;
    const cv::Mat& first = options.tiles->first;
    const int count = options.tiles->count;
    double least = 0, most = 0;
    if (first.type() == CV_32SC1) cv::minMaxLoc(first, &least, &most);
    if (first.type() != CV_32SC1 || count < kLaneMultiple || count % kLaneMultiple != 0 ||
        first.cols != (left.width + kTile - 1) / kTile || first.rows != (left.height + kTile - 1) / kTile ||
        least < 0 || most + count > range.count) {
      throw std::invalid_argument(
          "aggregation: tiles must cover the picture and search a multiple of 64 disparities inside the range");
    }
  }
  ChooseInstructionSet();
  if (FitsBytes(options)) {
    Aggregation<std::uint8_t>(left, right, range, options, winners).Run(buffers);
  } else {
    Aggregation<std::uint16_t>(left, right, range, options, winners).Run(buffers);
  }
}

}  // namespace granary
