// Natural pictures: the matcher against OpenCV's semi-global matching on the same pairs in the same run, where the
// pairs are at hand; skipped, saying so, where they are not.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <ostream>
#include <utility>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "pipeline/cloud_files.h"
#include "pipeline/stereo/match.h"
#include "tests/pipeline/natural_pictures.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

constexpr int kDisparities = 64;

/// Shares in percent of the non-occluded pixels from column kDisparities on, where every disparity has a partner.
struct Badness {
  double bad_1 = 0, bad_2 = 0;  ///< off by more than 1 or 2 px, of those that have a disparity
  double invalid = 0;
};

Badness Compare(const cv::Mat& disparity, const cv::Mat& truth, const cv::Mat& nonoccluded) {
  double all = 0, valid = 0, bad_1 = 0, bad_2 = 0;
  for (int y = 0; y < truth.rows; ++y) {
    for (int x = kDisparities; x < truth.cols; ++x) {
      if (nonoccluded.at<std::uint8_t>(y, x) == 0 || !std::isfinite(truth.at<float>(y, x))) continue;
      ++all;
      if (!std::isfinite(disparity.at<float>(y, x))) continue;
      ++valid;
      const float error = std::abs(disparity.at<float>(y, x) - truth.at<float>(y, x));
      bad_1 += error > 1;
      bad_2 += error > 2;
    }
  }
  return {100 * bad_1 / valid, 100 * bad_2 / valid, 100 * (all - valid) / all};
}

/// The best open census matcher measured on these pairs (rSGM, 5×5).
struct Case {
  const char* name;
  Badness peer;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class Middlebury : public testing::TestWithParam<Case> {};

TEST_P(Middlebury, MatcherIsBetterThanItsPeers) {
  const fs::path folder = fs::path(GRANARY_SAMPLES) / "stereo" / GetParam().name;
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is not here";
  const cv::Mat left = cv::imread((folder / "left.png").string(), cv::IMREAD_GRAYSCALE);
  const cv::Mat right = cv::imread((folder / "right.png").string(), cv::IMREAD_GRAYSCALE);
  const cv::Mat nonoccluded = cv::imread((folder / "nonoccluded.png").string(), cv::IMREAD_GRAYSCALE);
  const cv::Mat truth = ReadPfm(folder / "disparity.pfm");

  const Badness ours =
      Compare(MatchStereo(left, right, {0, kDisparities}, ForNaturalPictures()).disparity_px, truth, nonoccluded);

  // OpenCV's documentation suggests P1 = 8·n², P2 = 32·n² for an n×n block.
  cv::Mat fixed, disparity;
  cv::StereoSGBM::create(0, kDisparities, 3, 8 * 9, 32 * 9, 1, 0, 5, 100, 1, cv::StereoSGBM::MODE_HH)
      ->compute(left, right, fixed);
  fixed.convertTo(disparity, CV_32FC1, 1.0 / 16);
  disparity.setTo(std::numeric_limits<float>::infinity(), fixed < 0);
  const Badness opencv = Compare(disparity, truth, nonoccluded);

  for (const auto& [name, badness] : {std::pair{"ours", ours}, {"OpenCV MODE_HH", opencv}, {"rSGM", GetParam().peer}}) {
    std::printf("%s, %s: bad-1 %.2f %%, bad-2 %.2f %% of valid, invalid %.2f %%\n", GetParam().name, name,
                badness.bad_1, badness.bad_2, badness.invalid);
  }
  EXPECT_LT(ours.bad_1, GetParam().peer.bad_1);
  EXPECT_LT(ours.bad_2, GetParam().peer.bad_2);
  EXPECT_LT(ours.invalid, GetParam().peer.invalid);
  EXPECT_LT(ours.bad_2, opencv.bad_2);
  EXPECT_LT(ours.invalid, opencv.invalid);
}

INSTANTIATE_TEST_SUITE_P(Pairs, Middlebury,
                         testing::Values(Case{"teddy", {5.98, 3.61, 2.70}}, Case{"cones", {3.26, 2.37, 1.07}}));

}  // namespace
}  // namespace granary
