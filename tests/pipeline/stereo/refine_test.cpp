#include "pipeline/stereo/refine.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <tbb/global_control.h>
#include <Eigen/Dense>
#include <opencv2/core.hpp>

#include "pipeline/stereo/refine_shift.h"
#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

const cv::Size kSize{320, 240};
constexpr float kInvalid = std::numeric_limits<float>::infinity();

struct Input {
  cv::Mat left, right, truth_px;
};
Input MakeInput(const DisparityPlane& plane, double noise, unsigned seed, cv::Size size = kSize) {
  const StereoPair pair = RenderPlane(size, plane, noise, seed);
  Input in;
  pair.left.convertTo(in.left, CV_32FC1);
  pair.right.convertTo(in.right, CV_32FC1);
  in.truth_px.create(size, CV_32FC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) in.truth_px.at<float>(y, x) = static_cast<float>(plane.At(x, y));
  }
  return in;
}

// What census and semi-global matching would give: pulled to whole disparities, and 0.15 px of noise.
cv::Mat RoughStart(const cv::Mat& truth_px) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, 0.15);
  cv::Mat start(truth_px.size(), CV_32FC1);
  for (int y = 0; y < truth_px.rows; ++y) {
    for (int x = 0; x < truth_px.cols; ++x) {
      const double d = truth_px.at<float>(y, x);
      const double pulled = d - 0.1 * std::sin(2 * CV_PI * d) + normal(random);
      start.at<float>(y, x) = std::isfinite(d) ? static_cast<float>(pulled) : kInvalid;
    }
  }
  return start;
}

DisparityError Measure(const DisparityPlane& plane, double noise) {
  // 1800 windows side by side: the mean of their noise, 0.027 px at sigma 6, is known to 0.0006 px.
  const Input in = MakeInput(plane, noise, 1, {640, 480});
  const DisparityError e =
      CompareWithPlane(RefineDisparity(in.left, in.right, RoughStart(in.truth_px), {}).disparity_px, plane);
  std::printf("noise %.0f, plane %.2f %+.3f x %+.3f y: bias %+.4f rms %.4f locking %.4f px\n", noise, plane.d0,
              plane.slope_x, plane.slope_y, e.bias_px, e.rms_px, e.locking_px);
  return e;
}

// The figures the matcher promises; the right camera sees 0.7 of the left one's grey levels.
TEST(RefineDisparity, SlantedPlanesAtLowNoiseAreExact) {
  for (const DisparityPlane& plane : {DisparityPlane{20.3, 0.05, 0.03}, DisparityPlane{60.1, -0.07, 0.02}}) {
    const DisparityError e = Measure(plane, 2);  // measured: rms 0.010, locking 0.002
    EXPECT_LT(std::abs(e.bias_px), 0.001);
    EXPECT_LT(e.rms_px, 0.020);
    EXPECT_LT(e.locking_px, 0.02);
  }
}

TEST(RefineDisparity, SlantedPlanesAtHighNoiseAreExact) {
  for (const DisparityPlane& plane : {DisparityPlane{20.3, 0.05, 0.03}, DisparityPlane{60.1, -0.07, 0.02}}) {
    const DisparityError e = Measure(plane, 6);  // measured: rms 0.027, locking 0.008
    EXPECT_LT(std::abs(e.bias_px), 0.002);
    EXPECT_LT(e.rms_px, 0.045);
    EXPECT_LT(e.locking_px, 0.04);
  }
}

TEST(RefineDisparity, LevelPlanesAreNotPulledToWholeDisparities) {
  // Nothing averages over fractions here. Measured: 0.0013 at 20.25, what the interpolation leaves of dots 2 px wide.
  for (const double d0 : {20.05, 20.25, 20.5, 20.75, 20.95}) {
    EXPECT_LT(std::abs(Measure({d0, 0, 0}, 2).bias_px), 0.003) << d0;
  }
}

// A surface whose disparity is `disparity(x, y)` at the left pixel.
Input MakeSurface(const std::function<double(double, double)>& disparity, double noise) {
  const Speckle speckle(kSize, 5);
  Input in;
  Render(kSize, noise, 11, [&](int x, int y) { return speckle.At(x, y); }).convertTo(in.left, CV_32FC1);
  Render(kSize, noise, 12, [&](int x, int y) {
    double left_x = x;
    for (int i = 0; i < 60; ++i) left_x = std::min(x + disparity(left_x, y), kSize.width + 70.0);
    return 0.7 * speckle.At(left_x, y);
  }).convertTo(in.right, CV_32FC1);
  in.truth_px.create(kSize, CV_32FC1);
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) in.truth_px.at<float>(y, x) = static_cast<float>(disparity(x, y));
  }
  return in;
}

TEST(RefineDisparity, CrestsAndTroughsAreNotFlattened) {
  // Curvature 0.011 px/px²: the surface bends by 0.2 px within a window. One flattening pass would leave 0.06 px.
  const auto wave = [](double x, double y) { return 22 + 4 * std::sin(CV_PI * x / 60) * std::sin(CV_PI * y / 60 + 1); };
  const Input in = MakeSurface(wave, 2);
  const cv::Mat refined = RefineDisparity(in.left, in.right, RoughStart(in.truth_px), {}).disparity_px;
  double crest = 0, trough = 0, crests = 0, troughs = 0;
  for (int y = 20; y < kSize.height - 20; ++y) {
    for (int x = 60; x < kSize.width - 20; ++x) {
      const double error = refined.at<float>(y, x) - in.truth_px.at<float>(y, x);
      if (in.truth_px.at<float>(y, x) > 25.2) crest += error, ++crests;
      if (in.truth_px.at<float>(y, x) < 18.8) trough += error, ++troughs;
    }
  }
  std::printf("crests %+.4f px, troughs %+.4f px\n", crest / crests, trough / troughs);
  EXPECT_LT(std::abs(crest / crests), 0.015);
  EXPECT_LT(std::abs(trough / troughs), 0.015);
}

class RefineNoise : public testing::TestWithParam<std::tuple<double, double>> {};

TEST_P(RefineNoise, StatedDeviationIsTheActualError) {
  const auto [noise, slope] = GetParam();
  const DisparityPlane plane{20.3, slope, slope / 2};
  const Input in = MakeInput(plane, noise, 1);
  const Refined refined = RefineDisparity(in.left, in.right, in.truth_px, {});
  double total = 0, squares = 0, variances = 0;
  int n = 0;
  for (int y = 16; y < kSize.height - 16; ++y) {
    for (int x = 64; x < kSize.width - 16; ++x) {
      const double deviation = refined.deviation_px.at<float>(y, x);
      if (!(deviation < 0.29)) continue;  // refined
      const double error = refined.disparity_px.at<float>(y, x) - in.truth_px.at<float>(y, x);
      total += error;
      squares += error * error;
      variances += deviation * deviation;
      ++n;
    }
  }
  // The deviation states noise; the bias of a level plane, 0.001 px, is a term of its own in the volume's budget.
  const double actual = std::sqrt(squares / n - total / n * total / n), stated = std::sqrt(variances / n);
  std::printf("noise %.0f, slope %.2f: error %.4f px, stated %.4f px, ratio %.3f\n", noise, slope, actual, stated,
              actual / stated);
  RecordProperty("ratio", std::to_string(actual / stated));
  EXPECT_GT(n, 0.95 * 208 * 240);
  EXPECT_NEAR(actual / stated, 1, 0.20);
}
INSTANTIATE_TEST_SUITE_P(Noises, RefineNoise,
                         testing::Combine(testing::Values(2.0, 6.0), testing::Values(0.0, 0.05, 0.1)));

TEST(RefineDisparity, StartsUpToHalfAPixelOffComeBack) {
  for (const double off : {-0.5, -0.25, 0.25, 0.5}) {
    const DisparityPlane plane{20.3, 0.05, 0.03};
    const Input in = MakeInput(plane, 2, 1);
    const Refined refined = RefineDisparity(in.left, in.right, in.truth_px + off, {});
    // Two passes leave a few hundredths of the start's error.
    EXPECT_LT(std::abs(CompareWithPlane(refined.disparity_px, plane).bias_px), 0.02) << off;
  }
}

TEST(RefineDisparity, MorePassesDoNotAddNoise) {
  const DisparityPlane plane{20.4, 0.02, 0.01};
  const Input in = MakeInput(plane, 6, 1);
  const auto rms = [&](int passes) {
    return CompareWithPlane(RefineDisparity(in.left, in.right, in.truth_px, {.iterations = passes}).disparity_px, plane)
        .rms_px;
  };
  // From a perfect start one pass carries the noise once, many 1.16 times.
  EXPECT_LT(rms(6), 1.2 * rms(1));
  EXPECT_LT(rms(6), 1.02 * rms(3));
}

TEST(RefineDisparity, BrightnessOfEitherCameraDoesNotMatter) {
  const DisparityPlane plane{20.4, 0.02, 0.01};
  const Input in = MakeInput(plane, 2, 1);
  const cv::Mat plain = RefineDisparity(in.left, in.right, in.truth_px, {}).disparity_px;
  const cv::Mat brighter = RefineDisparity(in.left, in.right * 2.5 + 40, in.truth_px, {}).disparity_px;
  EXPECT_LT(cv::norm(plain, brighter, cv::NORM_INF, (plain < 1e6) & (brighter < 1e6)), 1e-2);  // float rounding
}

TEST(RefineDisparity, InvalidPixelsStayInvalid) {
  Input in = MakeInput({20.3, 0, 0}, 2, 1);
  in.truth_px(cv::Rect(100, 100, 30, 20)).setTo(kInvalid);
  const Refined refined = RefineDisparity(in.left, in.right, in.truth_px, {});
  EXPECT_EQ(cv::countNonZero((refined.disparity_px > 1e6) != (in.truth_px > 1e6)), 0);
  EXPECT_EQ(cv::countNonZero(refined.deviation_px(cv::Rect(100, 100, 30, 20)) > 0), 0);
}

TEST(RefineDisparity, WithoutTextureThePixelKeepsItsDisparityAndSaysSo) {
  const cv::Mat blank(kSize, CV_32FC1, cv::Scalar(80)), start(kSize, CV_32FC1, cv::Scalar(12.25));
  const Refined refined = RefineDisparity(blank, blank, start, {});
  EXPECT_EQ(cv::countNonZero(refined.disparity_px != start), 0);
  EXPECT_EQ(cv::countNonZero(refined.deviation_px != 0.3f), 0);
}

// A nearer wall to the right of kEdge. The left picture alone sees the strip that the wall hides from the right one.
constexpr int kEdge = 180;
Input MakeStep(double far_px, double near_px) {
  const Speckle far(kSize, 1), near(kSize, 2);
  Input in;
  Render(kSize, 2, 3, [&](int x, int y) {
    return x >= kEdge ? near.At(x, y) : far.At(x, y);
  }).convertTo(in.left, CV_32FC1);
  Render(kSize, 2, 4, [&](int x, int y) {
    return x + near_px >= kEdge ? near.At(x + near_px, y) : far.At(x + far_px, y);
  }).convertTo(in.right, CV_32FC1);
  in.truth_px.create(kSize, CV_32FC1);
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const bool hidden = x < kEdge && x - far_px + near_px >= kEdge;
      in.truth_px.at<float>(y, x) = hidden ? kInvalid : static_cast<float>(x >= kEdge ? near_px : far_px);
    }
  }
  return in;
}

TEST(RefineDisparity, AWallIsNotSmearedIntoTheGrain) {
  for (const double near_px : {18.6, 28.6}) {
    const Input in = MakeStep(16.3, near_px);
    const Refined refined = RefineDisparity(in.left, in.right, RoughStart(in.truth_px), {});
    double bias[2] = {0, 0}, squares = 0, count[2] = {0, 0};
    int unrefined = 0;
    for (int y = 16; y < kSize.height - 16; ++y) {
      for (int x = kEdge - 30; x < kEdge + 7; ++x) {
        const double error = refined.disparity_px.at<float>(y, x) - in.truth_px.at<float>(y, x);
        if (!std::isfinite(error) || (x < kEdge && in.truth_px.at<float>(y, x + 7) == in.truth_px.at<float>(y, x))) {
          continue;  // only the windows that see the step
        }
        bias[x >= kEdge] += error;
        ++count[x >= kEdge];
        squares += error * error;
        unrefined += refined.deviation_px.at<float>(y, x) == 0.3f;
      }
    }
    std::printf("step of %.1f px: ground %+.4f px, wall %+.4f px, rms %.4f px, unrefined %d of %.0f\n", near_px - 16.3,
                bias[0] / count[0], bias[1] / count[1], std::sqrt(squares / (count[0] + count[1])), unrefined,
                count[0] + count[1]);
    // The start's own error is 0.17 px.
    EXPECT_LT(std::abs(bias[0] / count[0]), 0.02) << near_px;
    EXPECT_LT(std::abs(bias[1] / count[1]), 0.02) << near_px;
    EXPECT_LT(std::sqrt(squares / (count[0] + count[1])), 0.1) << near_px;
    EXPECT_LT(unrefined, 0.02 * (count[0] + count[1])) << near_px;
  }
}

TEST(RefineDisparity, AHardBrightPatchCostsOnlyItsOwnPixels) {
  const DisparityPlane plane{20.3, 0.02, 0.01};
  const Input in = MakeInput(plane, 2, 1);
  const cv::Rect patch(150, 100, 20, 16);
  Input lit = in;
  lit.left = in.left.clone();
  lit.left(patch).setTo(255);
  const cv::Mat usable = lit.left < 255;
  const Refined masked = RefineDisparity(lit.left, in.right, in.truth_px, {}, usable);
  double masked_squares = 0;
  int count = 0;
  for (int y = patch.y - 6; y < patch.y + patch.height + 6; ++y) {
    for (int x = patch.x - 6; x < patch.x + patch.width + 6; ++x) {
      if (patch.contains({x, y})) continue;
      masked_squares += std::pow(masked.disparity_px.at<float>(y, x) - plane.At(x, y), 2);
      ++count;
    }
  }
  std::printf("around the patch: rms %.4f px\n", std::sqrt(masked_squares / count));
  // Half the window is left at the patch's rim, so the noise of 0.010 px grows by up to 1.5.
  EXPECT_LT(std::sqrt(masked_squares / count), 0.02);
  // In its middle no window has pixels enough.
  EXPECT_EQ(masked.deviation_px.at<float>(108, 160), 0.3f);
}

TEST(RefineDisparity, UnusablePixelsOfTheRightPictureAreLeftOut) {
  const DisparityPlane plane{20, 0, 0};
  Input in = MakeInput(plane, 2, 1);
  const cv::Mat plain = RefineDisparity(in.left, in.right, in.truth_px, {}).disparity_px;
  cv::Mat usable(kSize, CV_8UC1, cv::Scalar(255));
  usable(cv::Rect(130, 100, 20, 16)).setTo(0);
  cv::Mat one = in.right.clone(), other = in.right.clone();
  one(cv::Rect(134, 100, 12, 16)).setTo(0);  // 4 px inside: the spline carries a little further than what it reads
  other(cv::Rect(134, 100, 12, 16)).setTo(255);
  const cv::Mat a = RefineDisparity(in.left, one, in.truth_px, {}, {}, usable).disparity_px;
  const cv::Mat b = RefineDisparity(in.left, other, in.truth_px, {}, {}, usable).disparity_px;
  // 0.43^7 of the 255 grey levels are left at the nearest pixel that counts.
  EXPECT_LT(cv::norm(a, b, cv::NORM_INF), 0.02);
}

TEST(RefineDisparity, GreyValuesThatAreNoNumbersSpoilOnlyTheirWindows) {
  Input in = MakeInput({20.3, 0.02, 0.01}, 2, 1);
  const cv::Mat plain = RefineDisparity(in.left, in.right, in.truth_px, {}).disparity_px;
  in.left.at<float>(40, 60) = std::numeric_limits<float>::quiet_NaN();
  in.right.at<float>(40, 160) = kInvalid;
  const cv::Mat spoilt = RefineDisparity(in.left, in.right, in.truth_px, {}).disparity_px;
  const cv::Rect far(0, 100, kSize.width, 140);  // another band would not show it
  EXPECT_LT(cv::norm(plain(far), spoilt(far), cv::NORM_INF), 1e-3);
  EXPECT_EQ(cv::countNonZero(spoilt != spoilt), 0);
}

void ExpectSame(const Refined& a, const Refined& b) {
  // bit by bit: OpenCV compares what is no number in one way or the other, as the processor has it
  for (int y = 0; y < a.disparity_px.rows; ++y) {
    const std::size_t bytes = a.disparity_px.cols * sizeof(float);
    ASSERT_EQ(std::memcmp(a.disparity_px.ptr(y), b.disparity_px.ptr(y), bytes), 0) << "row " << y;
    ASSERT_EQ(std::memcmp(a.deviation_px.ptr(y), b.deviation_px.ptr(y), bytes), 0) << "row " << y;
  }
}

TEST(RefineDisparity, ThreadsDoNotChangeTheResult) {
  const Input in = MakeStep(16.3, 28.6);
  const cv::Mat start = RoughStart(in.truth_px);
  const auto with_threads = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return RefineDisparity(in.left, in.right, start, {});
  };
  ExpectSame(with_threads(1), with_threads(4));
}

/// Puts the processor's own choice back.
struct OwnTargets {
  static void Use(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  ~OwnTargets() { Use(0); }
};

TEST(RefineDisparity, EveryInstructionSetGivesTheSameBits) {
  const Input in = MakeStep(16.3, 28.6);
  const cv::Rect odd(0, 0, 317, 150);  // no multiple of any vector's length
  cv::Mat start = RoughStart(in.truth_px)(odd);
  const cv::Mat left = in.left(odd), right = in.right(odd);
  const Refined best = RefineDisparity(left, right, start, {});
  const OwnTargets restore;
  for (std::int64_t rest = hwy::SupportedTargets(); rest != 0; rest &= rest - 1) {
    OwnTargets::Use(rest & -rest);
    SCOPED_TRACE(hwy::TargetName(rest & -rest));
    ExpectSame(RefineDisparity(left, right, start, {}), best);
  }
}

// B-spline of degree n by its recursion, support [0, n + 1].
double Spline(int n, double x) {
  if (n == 0) return x >= 0 && x < 1 ? 1 : 0;
  return (x * Spline(n - 1, x) + (n + 1 - x) * Spline(n - 1, x - 1)) / n;
}

TEST(RefineDisparity, OnePassEqualsTheNormalEquationsOfTheWindow) {
  const DisparityPlane plane{20.3, 0.05, 0.03};
  const Input in = MakeInput(plane, 2, 1);
  constexpr int kRadius = 4;
  const Refined refined = RefineDisparity(in.left, in.right, in.truth_px, {.radius_px = kRadius, .iterations = 1});
  const std::vector<float> filter = SplineFilter();
  const int reach = static_cast<int>(filter.size()) - 1;
  const auto coefficient = [&](int x, int y) {
    double sum = 0;
    for (int i = -reach; i <= reach; ++i) sum += filter[std::abs(i)] * in.right.at<float>(y, x + i);
    return sum;
  };
  double least_ratio = 1e9, greatest_ratio = 0;
  for (const cv::Point p : {cv::Point(100, 60), cv::Point(171, 127), cv::Point(172, 129), cv::Point(240, 200)}) {
    Eigen::MatrixX3d a(81, 3);
    Eigen::VectorXd b(81);
    int i = 0;
    for (int y = p.y - kRadius; y <= p.y + kRadius; ++y) {
      for (int x = p.x - kRadius; x <= p.x + kRadius; ++x, ++i) {
        const float* l = in.left.ptr<float>(y) + x;
        const double at = x - plane.At(x, y);
        double warped = 0;
        for (int k = static_cast<int>(at) - 3; k <= static_cast<int>(at) + 4; ++k) {
          warped += coefficient(k, y) * Spline(5, at - k + 3);
        }
        a.row(i) << warped, -(8 * (l[1] - l[-1]) - (l[2] - l[-2])) / 12, 1;
        b(i) = l[0];
      }
    }
    const Eigen::Vector3d solution = a.colPivHouseholderQr().solve(b);
    const double refined_px = refined.disparity_px.at<float>(p);
    EXPECT_NEAR(refined_px, plane.At(p.x, p.y) + solution(1), 2e-4) << p;  // float sums
    const double variance = (b - a * solution).squaredNorm() / (81 - 3);
    const double deviation = std::sqrt(variance * (a.transpose() * a).inverse()(1, 1));
    // Beside this the stated one has a factor for the picture's correlation and one for the gradient's noise.
    const double ratio = refined.deviation_px.at<float>(p) / deviation;
    least_ratio = std::min(least_ratio, ratio);
    greatest_ratio = std::max(greatest_ratio, ratio);
  }
  EXPECT_LT(greatest_ratio / least_ratio, 1.05);
  EXPECT_NEAR(least_ratio, 1.1, 0.15);
}

TEST(RefineDisparity, PicturesSmallerThanAWindowKeepTheirDisparities) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(40, 1), cv::Size(1, 40), cv::Size(5, 7), cv::Size(16, 16)}) {
    const cv::Mat grey(size, CV_32FC1, cv::Scalar(7)), start(size, CV_32FC1, cv::Scalar(1.5));
    const Refined refined = RefineDisparity(grey, grey, start, {});
    EXPECT_EQ(cv::countNonZero(refined.disparity_px != start), 0) << size;
    EXPECT_EQ(cv::countNonZero(refined.deviation_px != 0.3f), 0) << size;
  }
}

TEST(RefineDisparity, RefusesPicturesOfAnotherTypeOrSize) {
  const cv::Mat good(20, 30, CV_32FC1, cv::Scalar(1)), bytes(20, 30, CV_8UC1, cv::Scalar(1)),
      other(20, 31, CV_32FC1, cv::Scalar(1));
  EXPECT_THROW(static_cast<void>(RefineDisparity(bytes, bytes, good, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(RefineDisparity(good, other, good, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(RefineDisparity(good, good, other, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(RefineDisparity({}, {}, {}, {})), std::invalid_argument);
}

TEST(RefineDisparity, RefusesMasksOfAnotherTypeOrSize) {
  const cv::Mat good(20, 30, CV_32FC1, cv::Scalar(1)), small(20, 29, CV_8UC1, cv::Scalar(1));
  EXPECT_THROW(static_cast<void>(RefineDisparity(good, good, good, {}, small)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(RefineDisparity(good, good, good, {}, {}, good)), std::invalid_argument);
}

TEST(RefineDisparity, RefusesOptionsThatMakeNoSense) {
  const cv::Mat good(20, 30, CV_32FC1, cv::Scalar(1));
  for (const RefineOptions& options :
       {RefineOptions{.radius_px = 0}, RefineOptions{.radius_px = 16}, RefineOptions{.iterations = 0},
        RefineOptions{.max_shift_px = 0}, RefineOptions{.max_shift_px = std::nan("")}}) {
    EXPECT_THROW(static_cast<void>(RefineDisparity(good, good, good, options)), std::invalid_argument);
  }
}

}  // namespace
}  // namespace granary
