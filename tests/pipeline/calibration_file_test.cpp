// stereo.yml and world.yml: what was written is read back, and every fault is one FileError that names file and key.
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/calibration_file.h"
#include "pipeline/file_error.h"
#include "tests/pipeline/temporary_folder.h"
#include "tests/pipeline/test_pictures.h"

namespace granary {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr const char* kStereo = R"(%YAML:1.0
---
image_width: 1280
image_height: 1024
K1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1500., 0., 634., 0., 1501., 518., 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.1, 0.09, 0.0004, -0.0003, 0. ]
K2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1502., 0., 647., 0., 1503., 507., 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.11, 0.08, 0., 0., 0. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -0.11, 0., 0.003 ]
)";

constexpr const char* kWorld = R"(%YAML:1.0
---
T_world_left: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [ 1., 0., 0., 0.2, 0., -1., 0., 0.1, 0., 0., -1., 1.1, 0., 0., 0., 1. ]
)";

/// The fault of kStereo with one thing replaced.
std::string StereoFault(const std::string& from, const std::string& to) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("stereo.yml", Replaced(kStereo, from, to));
  const std::string fault = FaultOf([&] { static_cast<void>(LoadStereoCalibration(file)); });
  EXPECT_THAT(fault, HasSubstr("stereo.yml: "));
  EXPECT_THAT(fault, testing::Not(HasSubstr("\n")));
  return fault;
}

std::string WorldFault(const std::string& from, const std::string& to) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("world.yml", Replaced(kWorld, from, to));
  return FaultOf([&] { static_cast<void>(LoadWorldFromLeft(file)); });
}

TEST(LoadStereoCalibration, ReadsEveryKey) {
  const TemporaryFolder folder;
  const StereoCalibration c = LoadStereoCalibration(folder.Write("stereo.yml", kStereo));
  EXPECT_EQ(c.image_size, cv::Size(1280, 1024));
  EXPECT_EQ(c.K1(0, 0), 1500);
  EXPECT_EQ(c.K2(1, 2), 507);
  EXPECT_EQ(c.D1, (std::vector<double>{-0.1, 0.09, 0.0004, -0.0003, 0}));
  EXPECT_EQ(c.D2.size(), 5U);
  EXPECT_EQ(c.R, cv::Matx33d::eye());
  EXPECT_EQ(c.T_m, cv::Vec3d(-0.11, 0, 0.003));
}

TEST(SaveStereoCalibration, ReadsBackBitForBit) {
  const TemporaryFolder folder;
  StereoCalibration c;
  c.image_size = {640, 480};
  c.K1 = {1000.0 / 3, 0, 320.1, 0, 1000.0 / 7, 239.9, 0, 0, 1};
  c.K2 = c.K1;
  c.D1 = std::vector<double>(14, 1.0 / 3);
  c.D2 = {0.1, 0.2, 0.3, 0.4};
  const double angle = 0.123456789;
  c.R = {std::cos(angle), -std::sin(angle), 0, std::sin(angle), std::cos(angle), 0, 0, 0, 1};
  c.T_m = {-1.0 / 9, 1e-17, 3e-3};
  SaveStereoCalibration(folder / "stereo.yml", c);
  const StereoCalibration back = LoadStereoCalibration(folder / "stereo.yml");
  EXPECT_EQ(back.image_size, c.image_size);
  EXPECT_EQ(back.K1, c.K1);
  EXPECT_EQ(back.K2, c.K2);
  EXPECT_EQ(back.D1, c.D1);
  EXPECT_EQ(back.D2, c.D2);
  EXPECT_EQ(back.R, c.R);
  EXPECT_EQ(back.T_m, c.T_m);
}

TEST(LoadStereoCalibration, MissingFileIsNamed) {
  EXPECT_THAT(FaultOf([] { static_cast<void>(LoadStereoCalibration("/nowhere/stereo.yml")); }),
              AllOf(HasSubstr("/nowhere/stereo.yml: "), HasSubstr("No such file")));
}
TEST(LoadStereoCalibration, AFolderIsNoFile) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { static_cast<void>(LoadStereoCalibration(folder.path())); }), HasSubstr("plain file"));
}
TEST(LoadStereoCalibration, EmptyFileIsNamed) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { static_cast<void>(LoadStereoCalibration(folder.Write("e.yml", ""))); }),
              HasSubstr("is empty"));
}
TEST(LoadStereoCalibration, TextThatIsNoYamlIsRefusedInSilence) {
  const TemporaryFolder folder;
  for (const char* text : {"hello", "\x89PNG\r\n", "%YAML:1.0\n---\nK1: [ 1, 2\n", "%YAML:1.0\n---\n",
                           "%YAML:1.0\n---\n- 1\n", "%YAML:1.0\n---\nK1: !!opencv-matrix\n   rows: 3\n"}) {
    testing::internal::CaptureStderr();
    EXPECT_THAT(FaultOf([&] { static_cast<void>(LoadStereoCalibration(folder.Write("bad.yml", text))); }),
                HasSubstr("bad.yml: "))
        << text;
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << text;
  }
}
TEST(LoadStereoCalibration, EveryMissingKeyIsNamed) {
  for (const std::string& key :
       std::vector<std::string>{"image_width", "image_height", "K1", "D1", "K2", "D2", "R", "T"}) {
    EXPECT_THAT(StereoFault("\n" + key + ":", "\nX" + key + ":"), HasSubstr(": " + key + ": is missing"));
  }
}
TEST(LoadStereoCalibration, ImageSizeMustBePositiveAndWhole) {
  EXPECT_THAT(StereoFault("1280", "0"), HasSubstr("image_width: is 0"));
  EXPECT_THAT(StereoFault("1024", "-5"), HasSubstr("image_height: is -5"));
  EXPECT_THAT(StereoFault("1280", "12.5"), HasSubstr("image_width: is 12.5"));
  EXPECT_THAT(StereoFault("1280", "wide"), HasSubstr("image_width: is no number"));
}
TEST(LoadStereoCalibration, WrongShapeIsNamed) {
  EXPECT_THAT(StereoFault("rows: 3\n   cols: 3\n   dt: d\n   data: [ 1500., 0., 634.,",
                          "rows: 2\n   cols: 3\n   dt: d\n   data: [ "),
              AllOf(HasSubstr("K1: is 2x3"), HasSubstr("3x3 is wanted")));
}
TEST(LoadStereoCalibration, ElementCountUnlikeTheShapeIsNamed) {
  EXPECT_THAT(StereoFault("1500., 0., 634.,", "1500., 0.,"), HasSubstr("K1: "));
}
TEST(LoadStereoCalibration, ScalarInPlaceOfAMatrixIsNamed) {
  EXPECT_THAT(
      StereoFault("T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ -0.11, 0., 0.003 ]", "T: 5"),
      HasSubstr("T: is no !!opencv-matrix"));
}
TEST(LoadStereoCalibration, NotANumberIsNamedWithItsPlace) {
  EXPECT_THAT(StereoFault("634.", ".Nan"), AllOf(HasSubstr("K1: element [0][2]"), HasSubstr("nan")));
  EXPECT_THAT(StereoFault("[ -0.1,", "[ .Inf,"), HasSubstr("D1: element [0][0]"));
  EXPECT_THAT(StereoFault("0.003 ]", "-.Inf ]"), HasSubstr("T: element [2][0]"));
}
TEST(LoadStereoCalibration, NanAsOtherProgramsWriteItIsRefused) {
  for (const char* nan : {"nan", "NaN", ".nan", ".NaN", "inf", ".inf", "null"}) {
    EXPECT_THAT(StereoFault("634.", nan), HasSubstr("stereo.yml: ")) << nan;
  }
}
TEST(LoadStereoCalibration, SixDistortionCoefficientsAreRefused) {
  EXPECT_THAT(StereoFault("cols: 5\n   dt: d\n   data: [ -0.1,", "cols: 6\n   dt: d\n   data: [ 0., -0.1,"),
              AllOf(HasSubstr("D1: is 1x6"), HasSubstr("4, 5, 8, 12 or 14")));
}
TEST(LoadStereoCalibration, FocalLengthMustBePositive) {
  EXPECT_THAT(StereoFault("1500.", "0."), HasSubstr("K1: fx = 0"));
  EXPECT_THAT(StereoFault("1503.", "-1503."), HasSubstr("K2: fx = 1502, fy = -1503"));
}
TEST(LoadStereoCalibration, CameraMatrixMustBeOne) {
  EXPECT_THAT(StereoFault("518., 0., 0., 1.", "518., 0., 0., 2."), HasSubstr("K1: is no camera matrix"));
}
TEST(LoadStereoCalibration, RotationMustBeOrthonormal) {
  EXPECT_THAT(StereoFault("[ 1., 0., 0., 0., 1.,", "[ 1., 0.001, 0., 0., 1.,"), HasSubstr("R: is no rotation"));
}
TEST(LoadStereoCalibration, RotationRoundedToFiveDigitsPasses) {
  const TemporaryFolder folder;
  // cos and sin of 0.1 rad rounded: off orthonormal by about 1e-5, inside the 1e-4 allowed.
  const std::string text = Replaced(kStereo, "[ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]",
                                    "[ 0.99500, -0.09983, 0., 0.09983, 0.99500, 0., 0., 0., 1. ]");
  EXPECT_NO_THROW(static_cast<void>(LoadStereoCalibration(folder.Write("s.yml", text))));
}
TEST(LoadStereoCalibration, MirroringIsRefused) {
  EXPECT_THAT(StereoFault("[ 1., 0., 0., 0., 1.,", "[ -1., 0., 0., 0., 1.,"), HasSubstr("R: is a mirroring"));
}
TEST(LoadStereoCalibration, ZeroBaselineIsRefused) {
  EXPECT_THAT(StereoFault("[ -0.11, 0., 0.003 ]", "[ 0., 0., 0. ]"), HasSubstr("T: is zero"));
}
TEST(LoadStereoCalibration, MillimetresAreSuspected) {
  EXPECT_THAT(StereoFault("[ -0.11, 0., 0.003 ]", "[ -110., 0., 3. ]"), HasSubstr("millimetres"));
}

/// The covariance of kStereo (24×24) with some elements set, as text of a file.
std::string WithCovariance(const cv::Mat& covariance) {
  cv::FileStorage storage(".yml", cv::FileStorage::WRITE | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML);
  storage << "covariance" << covariance;
  const std::string text = storage.releaseAndGetString();
  return kStereo + text.substr(text.find("covariance"));
}
cv::Mat Diagonal() {
  cv::Mat covariance = cv::Mat::zeros(24, 24, CV_64F);
  for (int i = 0; i < 24; ++i) covariance.at<double>(i, i) = i == 8 ? 0 : std::pow(10.0, -i / 2);
  return covariance;
}
std::string CovarianceFault(const cv::Mat& covariance) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("stereo.yml", WithCovariance(covariance));
  return FaultOf([&] { static_cast<void>(LoadStereoCalibration(file)); });
}
std::string CovarianceFault(int row, int col, double value, double mirrored) {
  cv::Mat covariance = Diagonal();
  covariance.at<double>(row, col) = value;
  covariance.at<double>(col, row) = mirrored;
  return CovarianceFault(covariance);
}

TEST(LoadStereoCalibration, AFileWithoutCovarianceHasNone) {
  const TemporaryFolder folder;
  EXPECT_TRUE(LoadStereoCalibration(folder.Write("stereo.yml", kStereo)).covariance.empty());
}
TEST(SaveStereoCalibration, WritesTheCovarianceBitForBitAndNoneWhereItIsUnknown) {
  const TemporaryFolder folder;
  StereoCalibration c = LoadStereoCalibration(folder.Write("stereo.yml", kStereo));
  SaveStereoCalibration(folder / "without.yml", c);
  EXPECT_TRUE(LoadStereoCalibration(folder / "without.yml").covariance.empty());
  c.covariance = Diagonal() / 3;
  SaveStereoCalibration(folder / "with.yml", c);
  const cv::Mat back = LoadStereoCalibration(folder / "with.yml").covariance;
  ASSERT_EQ(back.type(), CV_64FC1);
  ASSERT_EQ(back.size(), c.covariance.size());
  EXPECT_EQ(cv::countNonZero(back != c.covariance), 0);
}
TEST(LoadStereoCalibration, CovarianceMustFitTheCoefficients) {
  EXPECT_THAT(CovarianceFault(Diagonal()(cv::Rect(0, 0, 23, 23))),
              AllOf(HasSubstr("stereo.yml: covariance: is 23x23"), HasSubstr("24x24 is wanted")));
  EXPECT_THAT(CovarianceFault(Diagonal().rowRange(0, 6)), HasSubstr("covariance: is 6x24"));
}
TEST(LoadStereoCalibration, CovarianceMustBeFinite) {
  EXPECT_THAT(CovarianceFault(3, 3, std::nan(""), std::nan("")), HasSubstr("covariance: element [3][3] is nan"));
}
TEST(LoadStereoCalibration, CovarianceMustBeSymmetric) {
  EXPECT_THAT(CovarianceFault(2, 1, 0.01, 0.02), AllOf(HasSubstr("covariance: "), HasSubstr("not symmetric")));
}
TEST(LoadStereoCalibration, CovarianceMustHaveNoNegativeVariance) {
  EXPECT_THAT(CovarianceFault(5, 5, -1e-9, -1e-9), HasSubstr("covariance: element [5][5] is -1e-09"));
}
TEST(LoadStereoCalibration, CovarianceMustBePositiveAlongEveryDirection) {
  EXPECT_THAT(CovarianceFault(1, 0, 1.01, 1.01), HasSubstr("covariance: element [1][0]"));  // a correlation of 1.01
  EXPECT_THAT(CovarianceFault(8, 0, 0.1, 0.1), HasSubstr("covariance: element [8][0]"));    // 8 is held
  cv::Mat covariance = Diagonal();  // each pair may pass, the three together cannot: correlations of −0.9
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) covariance.at<double>(i, j) = i == j ? 1 : -0.9;
  }
  EXPECT_THAT(CovarianceFault(covariance), AllOf(HasSubstr("covariance: "), HasSubstr("eigenvalue")));
}
TEST(LoadStereoCalibration, CovarianceRoundedToFiveDigitsPasses) {
  cv::Mat covariance = Diagonal();
  covariance.at<double>(0, 1) = 1.00001;  // a correlation of 1 but for the last digit
  covariance.at<double>(1, 0) = 1.00002;
  covariance.at<double>(1, 1) = 1;
  const TemporaryFolder folder;
  EXPECT_NO_THROW(static_cast<void>(LoadStereoCalibration(folder.Write("s.yml", WithCovariance(covariance)))));
}

TEST(SaveWorldFromLeft, ReadsBackBitForBit) {
  const TemporaryFolder folder;
  RigidTransform pose = RigidTransform::Identity();
  pose.rotate(Eigen::AngleAxisd(2.9, Eigen::Vector3d(1, 0.1, 0.2).normalized()));
  pose.pretranslate(Eigen::Vector3d(1.0 / 3, 0.2, 1.1));
  SaveWorldFromLeft(folder / "world.yml", pose);
  EXPECT_EQ(LoadWorldFromLeft(folder / "world.yml").matrix(), pose.matrix());
}
TEST(LoadWorldFromLeft, FaultsNameTheKey) {
  EXPECT_THAT(WorldFault("T_world_left", "T_left_world"), HasSubstr("T_world_left: is missing"));
  EXPECT_THAT(WorldFault("rows: 4", "rows: 3"), HasSubstr("T_world_left: "));
  EXPECT_THAT(WorldFault("0.2", ".Nan"), HasSubstr("T_world_left: element [0][3] is nan"));
  EXPECT_THAT(WorldFault("[ 1.,", "[ 2.,"), HasSubstr("is no rotation"));
  EXPECT_THAT(WorldFault("[ 1.,", "[ -1.,"), HasSubstr("is a mirroring"));
  EXPECT_THAT(WorldFault("1.1, 0.,", "1.1, 0.5,"), HasSubstr("last row"));
}

}  // namespace
}  // namespace granary
