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
#include <opencv2/core.hpp>

namespace granary {
namespace {

CensusImage RandomCensus(cv::Size size, unsigned seed) {
  std::mt19937_64 random(seed);
  CensusImage census{size.width, size.height, std::vector<std::uint64_t>(size.area())};
  for (auto& word : census.words) word = random() >> 2;  // 62 bits
  return census;
}

/// The right picture is the left one, moved by `shift` with a fifth of the words replaced: sums with a structure.
CensusImage Moved(const CensusImage& left, int shift, unsigned seed) {
  CensusImage right = RandomCensus({left.width, left.height}, seed);
  std::mt19937 random(seed);
  for (int y = 0; y < left.height; ++y) {
    for (int x = 0; x < left.width; ++x) {
      const int from = x + shift;
      if (from >= 0 && from < left.width && random() % 5 != 0) right.words[y * left.width + x] = left.Row(y)[from];
    }
  }
  return right;
}

/// S(p, d) = Σ_r L_r(p, d) by the recursion of METHOD §3, [pixel][d], eight directions, one after the other.
std::vector<std::vector<int>> SumsByDefinition(const CensusImage& left, const CensusImage& right, DisparityRange range,
                                               const AggregateOptions& options) {
  const int width = left.width, height = left.height;
  const auto cost = [&](int x, int y, int d) {
    const int partner = x - range.min_px - d;
    if (partner < 0 || partner >= width) return options.census_bits;
    return static_cast<int>(std::bitset<64>(left.Row(y)[x] ^ right.Row(y)[partner]).count());
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
        for (int d = 0; d < range.count; ++d) here[d] = cost(x, y, d);
        if (!begins) {
          const auto& before = path[static_cast<std::size_t>(py) * width + px];
          const int least = *std::min_element(before.begin(), before.end());
          int p2 = options.p2;
          if (options.guide != nullptr) {
            const double gradient =
                std::abs(options.guide->at<float>(y, x) - options.guide->at<float>(py, px)) * options.guide_scale;
            // a gradient below one grey level is no edge
            p2 = std::max(options.p1 + 1, static_cast<int>(options.p2 / std::max(1.0, gradient)));
          }
          for (int d = 0; d < range.count; ++d) {
            int best = std::min(before[d], least + p2);
            if (d > 0) best = std::min(best, before[d - 1] + options.p1);
            if (d + 1 < range.count) best = std::min(best, before[d + 1] + options.p1);
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

struct Case {
  cv::Size size;
  DisparityRange range;
  int p1 = 10, p2 = 60;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.size.width << "x" << c.size.height << " from " << c.range.min_px << " D " << c.range.count << " P " << c.p1
       << "/" << c.p2;
}

void ExpectDefinition(const CensusImage& left, const CensusImage& right, DisparityRange range,
                      const AggregateOptions& options) {
  const CostSums sums = AggregateCosts(left, right, range, options);
  const auto truth = SumsByDefinition(left, right, range, options);
  for (int y = 0; y < left.height; ++y) {
    for (int x = 0; x < left.width; ++x) {
      for (int d = 0; d < range.count; ++d) {
        ASSERT_EQ(sums.At(y, x)[d], truth[static_cast<std::size_t>(y) * left.width + x][d])
            << "pixel " << x << ", " << y << ", index " << d;
      }
    }
  }
}

class AggregateSizes : public testing::TestWithParam<Case> {};

TEST_P(AggregateSizes, SumsEqualTheDefinition) {
  const Case& c = GetParam();
  const CensusImage left = RandomCensus(c.size, 1);
  ExpectDefinition(left, Moved(left, c.range.min_px + c.range.count / 3, 2), c.range, {.p1 = c.p1, .p2 = c.p2});
}
INSTANTIATE_TEST_SUITE_P(
    Cases, AggregateSizes,
    testing::Values(Case{{40, 30}, {0, 32}}, Case{{67, 19}, {5, 33}},                      // just past a vector
                    Case{{50, 1}, {3, 20}}, Case{{1, 50}, {0, 16}}, Case{{1, 1}, {0, 1}},  // strips
                    Case{{31, 17}, {-12, 25}},                                             // both signs
                    Case{{33, 12}, {-30, 7}}, Case{{33, 12}, {20, 64}},                    // mostly, or partly, outside
                    Case{{24, 9}, {0, 100}},                         // more disparities than columns
                    Case{{40, 20}, {2, 1}}, Case{{40, 20}, {2, 2}},  // nearly no range
                    Case{{45, 21}, {0, 31}, 1, 2}, Case{{45, 21}, {0, 31}, 100, 1000}));  // the options' limits

TEST(AggregateCosts, AdaptivePenaltyEqualsTheDefinition) {
  const CensusImage left = RandomCensus({41, 27}, 3);
  const CensusImage right = Moved(left, 9, 4);
  std::mt19937 random(5);
  cv::Mat guide(27, 41, CV_32FC1);
  // from no gradient to one that brings P2 to its floor
  for (auto it = guide.begin<float>(); it != guide.end<float>(); ++it) *it = static_cast<float>(random() % 4096);
  guide(cv::Rect(10, 5, 12, 12)).setTo(100);
  ExpectDefinition(left, right, {2, 37}, {.p1 = 10, .p2 = 400, .guide = &guide, .guide_scale = 0.01});
}

TEST(AggregateCosts, AFlatGuideIsTheFixedPenalty) {
  const CensusImage left = RandomCensus({30, 20}, 6);
  const CensusImage right = Moved(left, 4, 7);
  const cv::Mat guide(20, 30, CV_32FC1, cv::Scalar(50));
  EXPECT_EQ(AggregateCosts(left, right, {0, 16}, {.p1 = 10, .p2 = 60, .guide = &guide}).sums,
            AggregateCosts(left, right, {0, 16}, {.p1 = 10, .p2 = 60}).sums);
}

TEST(AggregateCosts, ThreadsDoNotChangeTheSums) {
  const CensusImage left = RandomCensus({93, 70}, 8);
  const CensusImage right = Moved(left, 20, 9);
  const auto with_threads = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return AggregateCosts(left, right, {0, 45}, {}).sums;
  };
  const auto one = with_threads(1);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(with_threads(4), one);
}

/// Puts the processor's own choice back.
struct OwnTargets {
  static void Use(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  ~OwnTargets() { Use(0); }
};

TEST(AggregateCosts, EveryInstructionSetGivesTheSameSumsAndWinners) {
  const CensusImage left = RandomCensus({77, 30}, 10);
  const CensusImage right = Moved(left, 20, 11);
  const DisparityRange range{-3, 71};
  const CostSums sums = AggregateCosts(left, right, range, {});
  const Winners winners = TakeWinners(sums, range, 0.05);
  const OwnTargets restore;
  int tried = 0;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    OwnTargets::Use(target);
    const CostSums again = AggregateCosts(left, right, range, {});
    EXPECT_EQ(again.sums, sums.sums) << hwy::TargetName(target);
    const Winners winners_again = TakeWinners(again, range, 0.05);
    for (const auto& [a, b] : {std::pair{winners.left_index, winners_again.left_index},
                               {winners.right_index, winners_again.right_index},
                               {winners.subpixel, winners_again.subpixel},
                               {winners.unique, winners_again.unique}}) {
      EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0) << hwy::TargetName(target);
    }
    ++tried;
  }
  RecordProperty("targets", tried);
  EXPECT_GE(tried, 1);
}

TEST(AggregateCosts, RefusesPicturesThatDoNotFit) {
  const CensusImage a = RandomCensus({20, 10}, 1), b = RandomCensus({20, 11}, 1), none;
  EXPECT_THROW(static_cast<void>(AggregateCosts(a, b, {0, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(AggregateCosts(none, none, {0, 8}, {})), std::invalid_argument);
}

TEST(AggregateCosts, RefusesAnEmptyRange) {
  const CensusImage a = RandomCensus({20, 10}, 1);
  EXPECT_THROW(static_cast<void>(AggregateCosts(a, a, {0, 0}, {})), std::invalid_argument);
}

/// Random sums for a picture, few enough values that ties are common.
CostSums RandomSums(cv::Size size, int count, int levels, unsigned seed) {
  CostSums sums{size.width, size.height, count, (count + 31) / 32 * 32, {}};
  std::mt19937 random(seed);
  sums.sums.resize(static_cast<std::size_t>(size.area()) * sums.stride);
  for (auto& s : sums.sums) s = static_cast<std::uint16_t>(100 + random() % levels);
  return sums;
}

class WinnersOfRange : public testing::TestWithParam<DisparityRange> {};

TEST_P(WinnersOfRange, LeftAndRightIndexAreTheLeastSumsInsideThePicture) {
  const DisparityRange range = GetParam();
  const CostSums sums = RandomSums({53, 6}, range.count, 60, 1);
  const Winners winners = TakeWinners(sums, range, 0);
  for (int y = 0; y < sums.height; ++y) {
    for (int x = 0; x < sums.width; ++x) {
      int left = -1, right = -1, left_least = 1 << 20, right_least = 1 << 20;
      for (int d = 0; d < range.count; ++d) {
        const int partner = x - range.min_px - d;  // of the left pixel x
        if (partner >= 0 && partner < sums.width && sums.At(y, x)[d] < left_least) {
          left_least = sums.At(y, x)[d];
          left = d;
        }
        const int source = x + range.min_px + d;  // the left pixel that the right pixel x belongs to
        if (source >= 0 && source < sums.width && sums.At(y, source)[d] < right_least) {
          right_least = sums.At(y, source)[d];
          right = d;
        }
      }
      ASSERT_EQ(winners.left_index.at<std::int16_t>(y, x), left) << x << ", " << y;
      ASSERT_EQ(winners.right_index.at<std::int16_t>(y, x), right) << x << ", " << y;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Ranges, WinnersOfRange,
                         testing::Values(DisparityRange{0, 32}, DisparityRange{0, 33}, DisparityRange{-20, 41},
                                         DisparityRange{-60, 30}, DisparityRange{40, 50}, DisparityRange{0, 70},
                                         DisparityRange{7, 1}));

/// One pixel in the middle of a strip, its sums given, the range so that all disparities lie inside the picture.
Winners OnePixel(const std::vector<std::uint16_t>& values, double uniqueness) {
  const int count = static_cast<int>(values.size());
  CostSums sums{2 * count, 1, count, 32, {}};
  sums.sums.assign(static_cast<std::size_t>(sums.width) * sums.stride, 1000);
  std::copy(values.begin(), values.end(), sums.At(0, count));
  return TakeWinners(sums, {0, count}, uniqueness);
}

TEST(TakeWinners, EquiangularOffsetIsSymmetric) {
  const float right = OnePixel({200, 150, 100, 120, 200}, 0).subpixel.at<float>(0, 5);
  const float left = OnePixel({200, 120, 100, 150, 200}, 0).subpixel.at<float>(0, 5);
  EXPECT_FLOAT_EQ(right, -left);
  EXPECT_FLOAT_EQ(right, 0.5f * (50 - 20) / 50);  // Shimizu and Okutomi 2001
}

TEST(TakeWinners, EquiangularOffsetIsZeroForEqualSidesAndHalfForATie) {
  EXPECT_EQ(OnePixel({200, 150, 100, 150, 200}, 0).subpixel.at<float>(0, 5), 0);
  EXPECT_FLOAT_EQ(OnePixel({200, 150, 100, 100, 200}, 0).subpixel.at<float>(0, 5), 0.5f);
}

TEST(TakeWinners, NoOffsetAtTheEndsOfTheRange) {
  EXPECT_EQ(OnePixel({100, 150, 160, 170, 200}, 0).subpixel.at<float>(0, 5), 0);
  EXPECT_EQ(OnePixel({200, 170, 160, 150, 100}, 0).subpixel.at<float>(0, 5), 0);
}

TEST(TakeWinners, NeighbouringDisparitiesAreNoRivals) {
  EXPECT_EQ(OnePixel({200, 101, 100, 101, 200}, 0.5).unique.at<std::uint8_t>(0, 5), 255);
}

TEST(TakeWinners, ARivalWithinTheShareMakesAPixelAmbiguous) {
  EXPECT_EQ(OnePixel({105, 150, 100, 150, 200}, 0.05).unique.at<std::uint8_t>(0, 5), 0);
  EXPECT_EQ(OnePixel({106, 150, 100, 150, 200}, 0.05).unique.at<std::uint8_t>(0, 5), 255);
  EXPECT_EQ(OnePixel({200, 150, 100, 150, 105}, 0.05).unique.at<std::uint8_t>(0, 5), 0);
}

}  // namespace
}  // namespace granary
