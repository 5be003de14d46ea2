// Natural pictures: the matcher against OpenCV's semi-global matching on the same pairs in the same run, where the
// pairs are at hand; skipped, saying so, where they are not.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "pipeline/cloud_files.h"
#include "pipeline/stereo/match.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

constexpr int kDisparities = 64;

/// Shares in percent of the non-occluded pixels from column kDisparities on, where every disparity has a partner.
struct Badness {
  double bad_2 = 0;           ///< off by more than 2 px, or invalid
  double bad_2_of_valid = 0;  ///< off by more than 2 px, of those that have a disparity
};

Badness Compare(const cv::Mat& disparity, const cv::Mat& truth, const cv::Mat& nonoccluded) {
  double all = 0, valid = 0, wrong = 0;
  for (int y = 0; y < truth.rows; ++y) {
    for (int x = kDisparities; x < truth.cols; ++x) {
      if (nonoccluded.at<std::uint8_t>(y, x) == 0 || !std::isfinite(truth.at<float>(y, x))) continue;
      ++all;
      if (!std::isfinite(disparity.at<float>(y, x))) continue;
      ++valid;
      wrong += std::abs(disparity.at<float>(y, x) - truth.at<float>(y, x)) > 2;
    }
  }
  return {100 * (all - valid + wrong) / all, 100 * wrong / valid};
}

class Middlebury : public testing::TestWithParam<const char*> {};

TEST_P(Middlebury, MatcherIsNoWorseThanSemiGlobalMatchingOfOpenCV) {
  const fs::path folder = fs::path(GRANARY_SAMPLES) / "stereo" / GetParam();
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is not here";
  const cv::Mat left = cv::imread((folder / "left.png").string(), cv::IMREAD_GRAYSCALE);
  const cv::Mat right = cv::imread((folder / "right.png").string(), cv::IMREAD_GRAYSCALE);
  const cv::Mat nonoccluded = cv::imread((folder / "nonoccluded.png").string(), cv::IMREAD_GRAYSCALE);
  const cv::Mat truth = ReadPfm(folder / "disparity.pfm");

  const Badness ours = Compare(MatchStereo(left, right, {0, kDisparities}, {}).disparity_px, truth, nonoccluded);

  // OpenCV's documentation suggests P1 = 8·n², P2 = 32·n² for an n×n block.
  cv::Mat fixed, disparity;
  cv::StereoSGBM::create(0, kDisparities, 3, 8 * 9, 32 * 9, 1, 0, 5, 100, 1, cv::StereoSGBM::MODE_HH)
      ->compute(left, right, fixed);
  fixed.convertTo(disparity, CV_32FC1, 1.0 / 16);
  disparity.setTo(std::numeric_limits<float>::infinity(), fixed < 0);
  const Badness theirs = Compare(disparity, truth, nonoccluded);

  std::printf("%s: bad-2 %.2f %% against %.2f %%, of valid %.2f %% against %.2f %%\n", GetParam(), ours.bad_2,
              theirs.bad_2, ours.bad_2_of_valid, theirs.bad_2_of_valid);
  EXPECT_LE(ours.bad_2, theirs.bad_2);
  EXPECT_LE(ours.bad_2_of_valid, theirs.bad_2_of_valid);
}

INSTANTIATE_TEST_SUITE_P(Pairs, Middlebury, testing::Values("teddy", "cones"));

}  // namespace
}  // namespace granary
