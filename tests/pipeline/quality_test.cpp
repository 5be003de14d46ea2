// Verdicts on generated pictures.
#include "pipeline/quality.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

using testing::HasSubstr;

const cv::Size kSize{160, 120};
const cv::Mat kEverywhere(kSize, CV_8UC1, cv::Scalar(255));

/// Dots times `gain` on `shade`, noise of two grey levels.
cv::Mat Picture(double gain, double shade, unsigned seed = 1) {
  const Speckle speckle(kSize, seed);
  cv::Mat out;
  Render(kSize, 2, seed, [&](int x, int y) { return shade + gain * speckle.At(x, y); }).convertTo(out, CV_32FC1);
  return out;
}
Verdict Judge(const cv::Mat& left, const cv::Mat& right, const cv::Mat& mask = kEverywhere) {
  RectifiedPair pair;
  pair.left = left;
  pair.right = right;
  return JudgePictures(AssessPictures(pair, mask, mask), {});
}
Reason ReasonFor(const cv::Mat& picture) { return Judge(picture, picture).reason; }

TEST(JudgePictures, GoodSpeckleIsGood) { EXPECT_EQ(ReasonFor(Picture(1, 0)), Reason::kOk); }

TEST(JudgePictures, DarkPicturesAreTooDark) {
  EXPECT_EQ(ReasonFor(cv::Mat(kSize, CV_32FC1, cv::Scalar(0))), Reason::kTooDark);
  EXPECT_EQ(ReasonFor(Picture(0.01, 0)), Reason::kTooDark);
}

TEST(JudgePictures, FullPicturesAreSaturated) {
  EXPECT_EQ(ReasonFor(cv::Mat(kSize, CV_32FC1, cv::Scalar(255))), Reason::kSaturated);
  EXPECT_EQ(ReasonFor(Picture(6, 0)), Reason::kSaturated);
}

TEST(JudgePictures, FullTipsOfDotsAreNoSaturation) { EXPECT_EQ(ReasonFor(Picture(1.5, 0)), Reason::kOk); }

TEST(JudgePictures, LightWithoutDotsIsADarkProjector) { EXPECT_EQ(ReasonFor(Picture(0, 90)), Reason::kProjectorDark); }

TEST(JudgePictures, FaintDotsAreLowContrast) { EXPECT_EQ(ReasonFor(Picture(0.15, 100)), Reason::kLowContrast); }

TEST(JudgePictures, TheWorsePictureDecides) {
  const cv::Mat good = Picture(1, 0);
  EXPECT_EQ(Judge(good, Picture(0, 90)).reason, Reason::kProjectorDark);
  EXPECT_EQ(Judge(Picture(6, 0), good).reason, Reason::kSaturated);
  EXPECT_EQ(Judge(good, Picture(0.01, 0)).reason, Reason::kTooDark);
}

TEST(JudgePictures, OnlyTheMaskCounts) {
  cv::Mat picture = Picture(1, 0), mask = kEverywhere.clone();
  picture(cv::Rect(0, 0, 60, 120)).setTo(255);
  mask(cv::Rect(0, 0, 70, 120)).setTo(0);
  EXPECT_EQ(Judge(picture, picture, mask).reason, Reason::kOk);
  EXPECT_EQ(Judge(picture, picture).reason, Reason::kSaturated);
}

TEST(JudgePictures, NamesTheFigureAndTheLimit) {
  const cv::Mat dark(kSize, CV_32FC1, cv::Scalar(0));
  EXPECT_THAT(Judge(dark, dark).detail, AllOf(HasSubstr("0.0 %"), HasSubstr("at least 1.0 %")));
  EXPECT_EQ(Judge(Picture(1, 0), Picture(1, 0)).detail, "");
}

TEST(AssessPictures, ContrastDoesNotDependOnTheExposure) {
  RectifiedPair bright, dim;
  bright.left = bright.right = Picture(0.8, 0);
  dim.left = dim.right = Picture(0.8, 0) * 0.25;
  EXPECT_NEAR(AssessPictures(bright, kEverywhere, kEverywhere).speckle_contrast,
              AssessPictures(dim, kEverywhere, kEverywhere).speckle_contrast, 1e-5);  // floats
}

TEST(AssessPictures, GlareInACornerHidesNoSpeckleElsewhere) {
  RectifiedPair clean;
  clean.left = Picture(0.2, 4);
  clean.right = clean.left;
  RectifiedPair glaring;
  glaring.left = clean.left.clone();
  glaring.left(cv::Rect(0, 0, 64, 32)).setTo(255);  // two squares of twenty, many times as bright as the rest
  glaring.right = clean.right;
  EXPECT_NEAR(AssessPictures(glaring, kEverywhere, kEverywhere).speckle_contrast,
              AssessPictures(clean, kEverywhere, kEverywhere).speckle_contrast, 0.03);  // squares differ a little
}

}  // namespace
}  // namespace granary
