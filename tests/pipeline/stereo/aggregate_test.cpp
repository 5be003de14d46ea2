// The vector code against the equation, written out in scalars straight from METHOD §3.
#include "pipeline/stereo/aggregate.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstdint>
#include <limits>
#include <ostream>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

CensusImage RandomCensus(cv::Size size, unsigned seed, int bits = 62) {
  std::mt19937_64 random(seed);
  CensusImage census;
  census.Resize(size.width, size.height, bits);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const std::uint64_t word = random() >> (64 - bits);
      for (int k = 0; k < census.bytes; ++k)
        census.Row(y)[k * size.width + x] = static_cast<std::uint8_t>(word >> 8 * k);
    }
  }
  return census;
}

/// The right picture is the left one, moved by `shift` with a fifth of the words replaced: sums with a structure.
CensusImage Moved(const CensusImage& left, int shift, unsigned seed, int bits = 62) {
  CensusImage right = RandomCensus({left.width, left.height}, seed, bits);
  std::mt19937 random(seed);
  for (int y = 0; y < left.height; ++y) {
    for (int x = 0; x < left.width; ++x) {
      const int from = x + shift;
      if (from < 0 || from >= left.width || random() % 5 == 0) continue;
      for (int k = 0; k < left.bytes; ++k) right.Row(y)[k * left.width + x] = left.Row(y)[k * left.width + from];
    }
  }
  return right;
}

/// Whether a pixel searches disparity index d.
bool Searches(const AggregateOptions& options, int x, int y, int d) {
  if (options.tiles == nullptr) return true;
  const int first = options.tiles->first.at<int>(y / DisparityTiles::kTile_px, x / DisparityTiles::kTile_px);
  return d >= first && d < first + options.tiles->count;
}

constexpr int kWithoutLimit = 1 << 24;  // cost of a disparity that is not searched

/// S(p, d) = Σ_r L_r(p, d) by the recursion of METHOD §3, [pixel][d], eight directions, one after the other.
std::vector<std::vector<int>> SumsByDefinition(const CensusImage& left, const CensusImage& right, DisparityRange range,
                                               const AggregateOptions& options) {
  const int width = left.width, height = left.height;
  const auto cost = [&](int x, int y, int d) {
    const int partner = x - range.min_px - d;
    if (partner < 0 || partner >= width) return options.census_bits;
    return static_cast<int>(std::bitset<64>(left.Word(y, x) ^ right.Word(y, partner)).count());
  };
  std::vector<std::vector<int>> sums(static_cast<std::size_t>(width) * height, std::vector<int>(range.count, 0));
  for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}}) {
    std::vector<std::vector<int>> path(sums.size(), std::vector<int>(range.count));
    for (int j = 0; j < height; ++j) {
      for (int i = 0; i < width; ++i) {
        const int x = dx >= 0 ? i : width - 1 - i, y = dy >= 0 ? j : height - 1 - j;
        const int px = x - dx, py = y - dy;
        auto& here = path[static_cast<std::size_t>(y) * width + x];
        const bool begins = px < 0 || px >= width || py < 0 || py >= height;
        for (int d = 0; d < range.count; ++d) here[d] = Searches(options, x, y, d) ? cost(x, y, d) : kWithoutLimit;
        if (!begins) {
          const auto& before = path[static_cast<std::size_t>(py) * width + px];
          const int least = *std::min_element(before.begin(), before.end());
          int p2 = options.p2;
          if (options.guide != nullptr) {
            const double gradient =
                std::abs(options.guide->at<float>(y, x) - options.guide->at<float>(py, px)) * options.guide_scale;
            // a gradient below 20 grey levels is no edge
            p2 = std::max(options.p1 + 1, static_cast<int>(20.0 * options.p2 / std::max(20.0, gradient)));
          }
          for (int d = 0; d < range.count; ++d) {
            if (!Searches(options, x, y, d)) continue;
            int best = std::min(before[d], least + p2);
            // a path steps by one only between disparities that the pixel itself searches
            for (const int side : {d - 1, d + 1}) {
              if (side < 0 || side >= range.count || !Searches(options, x, y, side)) continue;
              best = std::min(best, before[side] + options.p1);
            }
            here[d] += best - least;
          }
        }
        auto& sum = sums[static_cast<std::size_t>(y) * width + x];
        for (int d = 0; d < range.count; ++d) sum[d] += here[d];
      }
    }
  }
  return sums;
}

/// Winner takes all as METHOD §3 and the docstring say, from sums by definition.
Winners WinnersByDefinition(const CensusImage& left, const CensusImage& right, DisparityRange range,
                            const AggregateOptions& options) {
  const int width = left.width, height = left.height;
  const auto sums = SumsByDefinition(left, right, range, options);
  Winners winners{cv::Mat(height, width, CV_16SC1, cv::Scalar(-1)), cv::Mat(height, width, CV_16SC1, cv::Scalar(-1)),
                  cv::Mat::zeros(height, width, CV_32FC1), cv::Mat::zeros(height, width, CV_8UC1)};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto seen = [&](int d) {
        return d >= 0 && d < range.count && x - range.min_px - d >= 0 && x - range.min_px - d < width &&
               Searches(options, x, y, d);
      };
      const auto& sum = sums[static_cast<std::size_t>(y) * width + x];
      int best = -1, best_right = -1, least_right = 0;
      for (int d = 0; d < range.count; ++d) {
        if (seen(d) && (best < 0 || sum[d] < sum[best])) best = d;
        const int source = x + range.min_px + d;  // the left pixel that the right pixel x belongs to
        if (source < 0 || source >= width || !Searches(options, source, y, d)) continue;
        const int value = sums[static_cast<std::size_t>(y) * width + source][d];
        if (best_right < 0 || value < least_right) {
          best_right = d;
          least_right = value;
        }
      }
      winners.left_index.at<std::int16_t>(y, x) = static_cast<std::int16_t>(best);
      winners.right_index.at<std::int16_t>(y, x) = static_cast<std::int16_t>(best_right);
      if (best < 0) continue;
      bool unique = true;
      for (int d = 0; d < range.count; ++d) {
        unique = unique && !(seen(d) && std::abs(d - best) > 1 && sum[d] <= sum[best] * (1.0 + options.uniqueness));
      }
      winners.unique.at<std::uint8_t>(y, x) = unique ? 255 : 0;
      if (!seen(best - 1) || !seen(best + 1)) continue;
      // Shimizu and Okutomi 2001
      const float down = static_cast<float>(sum[best - 1] - sum[best]),
                  up = static_cast<float>(sum[best + 1] - sum[best]);
      if (std::max(down, up) > 0) winners.subpixel.at<float>(y, x) = 0.5f * (down - up) / std::max(down, up);
    }
  }
  return winners;
}

void ExpectEqual(const Winners& a, const Winners& b) {
  EXPECT_EQ(cv::norm(a.left_index, b.left_index, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(a.right_index, b.right_index, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(a.subpixel, b.subpixel, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(a.unique, b.unique, cv::NORM_INF), 0);
}

Winners Find(const CensusImage& left, const CensusImage& right, DisparityRange range, const AggregateOptions& options) {
  AggregateBuffers buffers;
  Winners winners;
  FindWinners(left, right, range, options, buffers, winners);
  return winners;
}

void ExpectDefinition(const CensusImage& left, const CensusImage& right, DisparityRange range,
                      const AggregateOptions& options) {
  ExpectEqual(Find(left, right, range, options), WinnersByDefinition(left, right, range, options));
}

struct Case {
  cv::Size size;
  DisparityRange range;
  int p1 = 10, p2 = 60, bits = 62;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.size.width << "x" << c.size.height << " from " << c.range.min_px << " D " << c.range.count << " P " << c.p1
       << "/" << c.p2 << " bits " << c.bits;
}

AggregateOptions OptionsOf(const Case& c) {
  AggregateOptions options;
  options.p1 = c.p1;
  options.p2 = c.p2;
  options.census_bits = c.bits;
  options.uniqueness = 0.02;
  return options;
}

class FindWinnersCases : public testing::TestWithParam<Case> {};

TEST_P(FindWinnersCases, EqualTheDefinition) {
  const Case& c = GetParam();
  const CensusImage left = RandomCensus(c.size, 1, c.bits);
  ExpectDefinition(left, Moved(left, c.range.min_px + c.range.count / 3, 2, c.bits), c.range, OptionsOf(c));
}
INSTANTIATE_TEST_SUITE_P(
    Cases, FindWinnersCases,
    testing::Values(Case{{40, 30}, {0, 32}}, Case{{67, 19}, {5, 33}}, Case{{150, 12}, {0, 64}},
                    Case{{150, 12}, {0, 65}}, Case{{300, 7}, {3, 200}},                    // up to and past a vector
                    Case{{50, 1}, {3, 20}}, Case{{1, 50}, {0, 16}}, Case{{1, 1}, {0, 1}},  // strips
                    Case{{64, 10}, {0, 16}}, Case{{65, 10}, {0, 16}},                // whole segments and one more
                    Case{{31, 17}, {-12, 25}},                                       // both signs
                    Case{{33, 12}, {-30, 7}}, Case{{33, 12}, {20, 64}},              // mostly, or partly, outside
                    Case{{33, 12}, {-200, 7}}, Case{{33, 12}, {90, 7}},              // outside altogether
                    Case{{24, 9}, {0, 100}}, Case{{24, 9}, {-90, 190}},              // more disparities than columns
                    Case{{40, 20}, {2, 1}}, Case{{40, 20}, {2, 2}},                  // nearly no range
                    Case{{45, 21}, {0, 31}, 1, 2}, Case{{45, 21}, {0, 31}, 10, 63},  // bytes and their limit
                    Case{{45, 21}, {0, 31}, 10, 64},
                    Case{{150, 21}, {0, 70}, 100, 1000},  // 16 bits and the options' limit
                    Case{{60, 15}, {0, 40}, 10, 60, 8}, Case{{60, 15}, {0, 40}, 10, 60, 24},
                    Case{{60, 15}, {0, 40}, 10, 60, 48}));  // 3×3, 5×5, 7×7

TEST(FindWinners, FuzzedSizesEqualTheDefinition) {
  std::mt19937 random(12);
  const auto draw = [&](int low, int high) { return low + static_cast<int>(random() % (high - low + 1)); };
  for (int i = 0; i < 60; ++i) {
    Case c{{draw(1, 90), draw(1, 12)}, {draw(-40, 60), draw(1, 140)}, draw(1, 20), 0, draw(8, 62)};
    c.p2 = c.p1 + draw(1, 80);  // on both sides of what bytes hold
    SCOPED_TRACE(testing::PrintToString(c));
    const CensusImage left = RandomCensus(c.size, i, c.bits);
    AggregateOptions options = OptionsOf(c);
    options.sums_budget = draw(0, 1) == 0 ? 1 : options.sums_budget;  // bands of a row, or all at once
    ExpectDefinition(left, Moved(left, c.range.min_px + draw(0, c.range.count), i + 100, c.bits), c.range, options);
  }
}

TEST(FindWinners, TilesEqualTheDefinition) {
  std::mt19937 random(13);
  const auto draw = [&](int low, int high) { return low + static_cast<int>(random() % (high - low + 1)); };
  for (int i = 0; i < 24; ++i) {
    const Case c{{draw(1, 170), draw(1, 80)}, {draw(-40, 20), draw(64, 300)}, 10, i % 3 == 0 ? 100 : 60};
    SCOPED_TRACE(testing::PrintToString(c));
    DisparityTiles tiles;
    tiles.count = 64 * draw(1, c.range.count / 64);
    tiles.first.create((c.size.height + 31) / 32, (c.size.width + 31) / 32, CV_32SC1);
    // Now and then the same as elsewhere, now and then without anything in common with it.
    const int usual = draw(0, c.range.count - tiles.count);
    for (auto it = tiles.first.begin<int>(); it != tiles.first.end<int>(); ++it) {
      *it = draw(0, 2) == 0 ? usual : draw(0, c.range.count - tiles.count);
    }
    AggregateOptions options = OptionsOf(c);
    options.tiles = &tiles;
    options.sums_budget = draw(0, 1) == 0 ? 20 * c.size.width * tiles.count : options.sums_budget;
    const CensusImage left = RandomCensus(c.size, i);
    ExpectDefinition(left, Moved(left, c.range.min_px + usual + 20, i + 100), c.range, options);
  }
}

TEST(FindWinners, TilesThatSearchEverythingChangeNothing) {
  const CensusImage left = RandomCensus({100, 70}, 8);
  const CensusImage right = Moved(left, 20, 9);
  DisparityTiles tiles{128, cv::Mat(3, 4, CV_32SC1, cv::Scalar(0))};
  AggregateOptions options;
  options.tiles = &tiles;
  ExpectEqual(Find(left, right, {-3, 128}, options), Find(left, right, {-3, 128}, {}));
}

TEST(FindWinners, RefusesTilesThatDoNotFit) {
  const CensusImage a = RandomCensus({40, 20}, 1);
  const auto with = [&](int count, cv::Mat first) {
    const DisparityTiles tiles{count, first};
    AggregateOptions options;
    options.tiles = &tiles;
    return Find(a, a, {0, 100}, options);
  };
  EXPECT_NO_THROW(static_cast<void>(with(64, cv::Mat(1, 2, CV_32SC1, cv::Scalar(36)))));
  EXPECT_THROW(static_cast<void>(with(64, cv::Mat(1, 2, CV_32SC1, cv::Scalar(37)))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(with(64, cv::Mat(1, 2, CV_32SC1, cv::Scalar(-1)))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(with(64, cv::Mat(2, 2, CV_32SC1, cv::Scalar(0)))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(with(64, cv::Mat(1, 1, CV_32SC1, cv::Scalar(0)))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(with(65, cv::Mat(1, 2, CV_32SC1, cv::Scalar(0)))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(with(64, cv::Mat(1, 2, CV_8UC1, cv::Scalar(0)))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(with(64, {})), std::invalid_argument);
}

TEST(FindWinners, AdaptivePenaltyEqualsTheDefinition) {
  const CensusImage left = RandomCensus({41, 27}, 3);
  const CensusImage right = Moved(left, 9, 4);
  std::mt19937 random(5);
  cv::Mat guide(27, 41, CV_32FC1);
  // from no gradient to one that brings P2 to its floor
  for (auto it = guide.begin<float>(); it != guide.end<float>(); ++it) *it = static_cast<float>(random() % 4096);
  guide(cv::Rect(10, 5, 12, 12)).setTo(100);
  for (const int p2 : {60, 400}) {
    AggregateOptions options = OptionsOf({{}, {}, 10, p2});
    options.guide = &guide;
    options.guide_scale = 0.1;
    ExpectDefinition(left, right, {2, 37}, options);
  }
}

TEST(FindWinners, AFlatGuideIsTheFixedPenalty) {
  const CensusImage left = RandomCensus({30, 20}, 6);
  const CensusImage right = Moved(left, 4, 7);
  const cv::Mat guide(20, 30, CV_32FC1, cv::Scalar(50));
  AggregateOptions fixed, adaptive;
  adaptive.guide = &guide;
  ExpectEqual(Find(left, right, {0, 16}, adaptive), Find(left, right, {0, 16}, fixed));
}

TEST(FindWinners, BandsDoNotChangeTheResult) {
  const CensusImage left = RandomCensus({93, 71}, 8);
  const CensusImage right = Moved(left, 20, 9);
  const Winners whole = Find(left, right, {0, 45}, {});
  for (const int rows : {1, 2, 10, 23, 36, 70}) {
    AggregateOptions options;
    options.sums_budget = static_cast<std::size_t>(rows) * 93 * 64;
    SCOPED_TRACE(rows);
    ExpectEqual(Find(left, right, {0, 45}, options), whole);
  }
}

TEST(FindWinners, ThreadsDoNotChangeTheResult) {
  const CensusImage left = RandomCensus({193, 70}, 8);
  const CensusImage right = Moved(left, 20, 9);
  const auto with_threads = [&](int threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Winners winners;
    tbb::task_arena(threads).execute([&] { winners = Find(left, right, {0, 45}, {}); });
    return winners;
  };
  const Winners one = with_threads(1);
  for (const int threads : {2, 3, 4, 8, 16}) ExpectEqual(with_threads(threads), one);
}

TEST(FindWinners, BuffersOfAnotherPictureDoNotMatter) {
  AggregateBuffers buffers;
  Winners winners;
  const CensusImage large = RandomCensus({120, 60}, 20);
  FindWinners(large, large, {0, 90}, {}, buffers, winners);
  const CensusImage left = RandomCensus({50, 30}, 8);
  const CensusImage right = Moved(left, 20, 9);
  FindWinners(left, right, {0, 45}, {}, buffers, winners);
  ExpectEqual(winners, Find(left, right, {0, 45}, {}));
}

/// Puts the processor's own choice back.
struct OwnTargets {
  static void Use(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  ~OwnTargets() { Use(0); }
};

TEST(FindWinners, EveryInstructionSetEqualsTheDefinition) {
  const CensusImage left = RandomCensus({177, 20}, 10);
  const DisparityRange range{-3, 131};
  const CensusImage right = Moved(left, 20, 11);
  for (const int p2 : {60, 300}) {
    const AggregateOptions options = OptionsOf({{}, {}, 10, p2});
    const Winners truth = WinnersByDefinition(left, right, range, options);
    const OwnTargets restore;
    for (std::int64_t rest = hwy::SupportedTargets(); rest != 0; rest &= rest - 1) {
      OwnTargets::Use(rest & -rest);
      SCOPED_TRACE(hwy::TargetName(rest & -rest));
      ExpectEqual(Find(left, right, range, options), truth);
    }
  }
}

TEST(FindWinners, RefusesPicturesThatDoNotFit) {
  const CensusImage a = RandomCensus({20, 10}, 1), b = RandomCensus({20, 11}, 1), c = RandomCensus({20, 10}, 1, 24),
                    none;
  EXPECT_THROW(static_cast<void>(Find(a, b, {0, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Find(a, c, {0, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Find(none, none, {0, 8}, {})), std::invalid_argument);
}

TEST(FindWinners, RefusesRangesAndPenaltiesThatDoNotFit) {
  const CensusImage a = RandomCensus({20, 10}, 1);
  EXPECT_THROW(static_cast<void>(Find(a, a, {0, 0}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Find(a, a, {0, 40000}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Find(a, a, {0, 8}, OptionsOf({{}, {}, 10, 9}))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Find(a, a, {0, 8}, OptionsOf({{}, {}, -1, 9}))), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Find(a, a, {0, 8}, OptionsOf({{}, {}, 10, 5000}))), std::invalid_argument);
}

}  // namespace
}  // namespace granary
