// Disparity maps, clouds and meshes: what was written is read back, and every fault is one FileError that names file
// and fault.
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/cloud_files.h"
#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"
#include "tests/pipeline/temporary_folder.h"
#include "tests/pipeline/test_pictures.h"

namespace granary {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::string FloatBytes(float value) {
  std::string bytes(4, '\0');
  std::memcpy(bytes.data(), &value, 4);
  return bytes;
}
float FloatAt(const std::string& bytes, std::size_t at) {
  float value = 0;
  std::memcpy(&value, bytes.data() + at, 4);
  return value;
}

TEST(WritePfm, HasTheBytesOfMiddlebury) {
  const TemporaryFolder folder;
  WritePfm(folder / "d.pfm", (cv::Mat_<float>(2, 2) << 1, 2, kNan, 4));
  EXPECT_EQ(TemporaryFolder::Read(folder / "d.pfm"),
            "Pf\n2 2\n-1.0\n" + FloatBytes(kInf) + FloatBytes(4) + FloatBytes(1) + FloatBytes(2));
}
TEST(ReadPfm, ReadsBack) {
  const TemporaryFolder folder;
  const cv::Mat values = (cv::Mat_<float>(2, 3) << 1, 2, 3, 4.5, kInf, 6);
  WritePfm(folder / "d.pfm", values);
  const cv::Mat back = ReadPfm(folder / "d.pfm");
  ASSERT_EQ(back.size(), values.size());
  EXPECT_EQ(std::memcmp(back.data, values.data, 24), 0);
}
TEST(ReadPfm, ReadsBigEndian) {
  const TemporaryFolder folder;
  EXPECT_EQ(ReadPfm(folder.Write("b.pfm", std::string("Pf\n1 1\n1.0\n\x3f\x80\0\0", 15))).at<float>(0, 0), 1.0F);
}
TEST(ReadPfm, FaultsAreNamed) {
  const TemporaryFolder folder;
  const auto fault = [&](const std::string& bytes) {
    return FaultOf([&] { static_cast<void>(ReadPfm(folder.Write("d.pfm", bytes))); });
  };
  EXPECT_THAT(fault("PF\n1 1\n-1.0\n____________"), HasSubstr("colour PFM"));
  EXPECT_THAT(fault("hello"), HasSubstr("is no PFM"));
  EXPECT_THAT(fault("Pf\n1 x\n-1.0\n____"), HasSubstr("damaged header"));
  EXPECT_THAT(fault("Pf\n1 1\n0\n____"), HasSubstr("damaged header"));
  EXPECT_THAT(fault("Pf\n1 2\n-1.0\n____"), HasSubstr("is truncated"));
  EXPECT_THAT(fault("Pf\n1 1\n-1.0\n_____"), HasSubstr("is damaged"));
}
TEST(WritePfm, RefusesWhatIsNoMap) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { WritePfm(folder / "d.pfm", cv::Mat(30, 40, CV_8UC1, cv::Scalar(7))); }),
              HasSubstr("one float channel"));
}

Surface TwoTriangles() {
  Surface surface;
  surface.vertices_in_world = {{0, 0, 0.1}, {1, 0, 0.1}, {1, 1, 0.1}, {0, 1, 0.1}, {5, 5, 5}};
  surface.height_m = {0.1, 0.1, 0.1, 0.1, 5};
  surface.interpolated = {0, 0, 1, 0, 1};
  surface.triangles = {{0, 1, 2}, {0, 2, 3}};
  surface.triangle_interpolated = {1, 1};
  return surface;
}

TEST(WritePlyMesh, LaysOutWhatItsHeaderSays) {
  const TemporaryFolder folder;
  WritePlyMesh(folder / "m.ply", TwoTriangles());
  const std::string bytes = TemporaryFolder::Read(folder / "m.ply");
  EXPECT_THAT(bytes, testing::StartsWith("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_THAT(bytes,
              HasSubstr("element vertex 5\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
                        "property float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n"
                        "property uchar blue\nproperty uchar interpolated\n"
                        "element face 2\nproperty list uchar int vertex_indices\nend_header\n"));
  const std::size_t data = bytes.find("end_header\n") + 11;
  ASSERT_EQ(bytes.size(), data + 5 * 28 + 2 * 13);
  EXPECT_EQ(FloatAt(bytes, data + 28), 1.0F);           // x of vertex 1
  EXPECT_EQ(FloatAt(bytes, data + 28 + 8), 0.1F);       // z
  EXPECT_EQ(FloatAt(bytes, data + 28 + 20), 1.0F);      // nz: counter-clockwise from above points up
  EXPECT_EQ(bytes[data + 2 * 28 + 27], 1);              // vertex 2 was completed
  EXPECT_EQ(FloatAt(bytes, data + 4 * 28 + 20), 1.0F);  // a vertex of no triangle points up
  const std::size_t faces = data + 5 * 28;
  EXPECT_EQ(bytes[faces], 3);
  EXPECT_EQ(bytes.substr(faces + 14, 12), std::string("\0\0\0\0\2\0\0\0\3\0\0\0", 12));
}
std::string ColourBytes(const Rgb& colour) { return {colour.begin(), colour.end()}; }
TEST(WritePlyMesh, ColoursMeasuredAndCompletedVertices) {
  const TemporaryFolder folder;
  WritePlyMesh(folder / "m.ply", TwoTriangles());
  const std::string bytes = TemporaryFolder::Read(folder / "m.ply");
  const std::size_t data = bytes.find("end_header\n") + 11;
  EXPECT_EQ(bytes.substr(data + 1 * 28 + 24, 3), ColourBytes(kMeasuredColour));
  EXPECT_EQ(bytes.substr(data + 2 * 28 + 24, 3), ColourBytes(kCompletedColour));
}
TEST(WritePlyCloud, HasNoFaces) {
  const TemporaryFolder folder;
  WritePlyCloud(folder / "c.ply", TwoTriangles());
  const std::string bytes = TemporaryFolder::Read(folder / "c.ply");
  EXPECT_THAT(bytes, testing::Not(HasSubstr("face")));
  EXPECT_EQ(bytes.size(), bytes.find("end_header\n") + 11 + 5 * 28);
}
TEST(WritePlyPoints, WritesPlacesAndColours) {
  const TemporaryFolder folder;
  const std::vector<Eigen::Vector3f> points{{1, 2, 3}, {4, 5, 6}};
  const std::vector<Rgb> colours{{1, 2, 3}, {250, 128, 0}};
  WritePlyPoints(folder / "p.ply", points, colours);
  const std::string bytes = TemporaryFolder::Read(folder / "p.ply");
  EXPECT_THAT(bytes, HasSubstr("element vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
                               "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"));
  const std::size_t data = bytes.find("end_header\n") + 11;
  EXPECT_EQ(bytes.substr(data), FloatBytes(1) + FloatBytes(2) + FloatBytes(3) + ColourBytes(colours[0]) +
                                    FloatBytes(4) + FloatBytes(5) + FloatBytes(6) + ColourBytes(colours[1]));
}
TEST(WritePlyPoints, WantsOneColourAPoint) {
  const TemporaryFolder folder;
  const std::vector<Eigen::Vector3f> points{{1, 2, 3}};
  EXPECT_THAT(FaultOf([&] { WritePlyPoints(folder / "p.ply", points, {}); }), HasSubstr("one colour a point"));
}
TEST(WritePlyMesh, AnEmptySurfaceIsAnEmptyFile) {
  const TemporaryFolder folder;
  WritePlyMesh(folder / "m.ply", Surface{});
  EXPECT_THAT(TemporaryFolder::Read(folder / "m.ply"), HasSubstr("element vertex 0\n"));
}

cv::Mat SomePoints() {
  cv::Mat points(2, 3, CV_32FC3, cv::Scalar::all(kNan));
  points.at<cv::Vec3f>(0, 0) = {1, 2, 3};
  points.at<cv::Vec3f>(1, 2) = {-0.1F, 1e-9F, 7};
  return points;
}
bool SameBytes(const cv::Mat& a, const cv::Mat& b) {
  return a.type() == b.type() && a.size() == b.size() && std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

TEST(ReadPcd, ReadsBackBitForBitNansIncluded) {
  const TemporaryFolder folder;
  const cv::Mat noise = (cv::Mat_<float>(2, 3) << 1, kNan, 3, 4, 5, 6);
  WritePcd(folder / "c.pcd", SomePoints(), noise);
  const PcdCloud back = ReadPcd(folder / "c.pcd");
  EXPECT_TRUE(SameBytes(back.points, SomePoints()));
  EXPECT_TRUE(SameBytes(back.noise_m, noise));
}
TEST(ReadPcd, NoiseMayBeAbsent) {
  const TemporaryFolder folder;
  WritePcd(folder / "c.pcd", SomePoints());
  const PcdCloud back = ReadPcd(folder / "c.pcd");
  EXPECT_TRUE(SameBytes(back.points, SomePoints()));
  EXPECT_TRUE(back.noise_m.empty());
}
TEST(WritePcd, IsOrganisedAsThePicture) {
  const TemporaryFolder folder;
  WritePcd(folder / "c.pcd", SomePoints());
  const std::string bytes = TemporaryFolder::Read(folder / "c.pcd");
  EXPECT_THAT(bytes, HasSubstr("VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 2\n"
                               "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 6\nDATA binary\n"));
  EXPECT_EQ(FloatAt(bytes, bytes.size() - 4), 7.0F);
}
TEST(WritePcd, RefusesNoiseOfAnotherSize) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { WritePcd(folder / "c.pcd", SomePoints(), cv::Mat(1, 1, CV_32FC1)); }), HasSubstr("noise"));
  EXPECT_THAT(FaultOf([&] { WritePcd(folder / "c.pcd", cv::Mat(30, 40, CV_8UC1, cv::Scalar(7))); }),
              HasSubstr("three floats"));
}
TEST(ReadPcd, FaultsAreNamed) {
  const TemporaryFolder folder;
  WritePcd(folder / "c.pcd", SomePoints());
  const std::string whole = TemporaryFolder::Read(folder / "c.pcd");
  const auto fault = [&](const std::string& bytes) {
    return FaultOf([&] { static_cast<void>(ReadPcd(folder.Write("bad.pcd", bytes))); });
  };
  EXPECT_THAT(fault(whole.substr(0, whole.size() - 1)), HasSubstr("is truncated"));
  EXPECT_THAT(fault(whole + "x"), HasSubstr("is damaged"));
  EXPECT_THAT(fault(whole.substr(0, 30)), HasSubstr("is no PCD"));
  EXPECT_THAT(fault(Replaced(whole, "DATA binary", "DATA ascii")), HasSubstr("DATA is \"ascii\""));
  EXPECT_THAT(fault(Replaced(whole, "x y z", "x y i")), HasSubstr("FIELDS is"));
  EXPECT_THAT(fault(Replaced(whole, "WIDTH 3", "WIDTH 0")), HasSubstr("WIDTH and HEIGHT"));
  EXPECT_THAT(fault(Replaced(whole, "WIDTH 3", "WIDTH -3")), HasSubstr("WIDTH and HEIGHT"));
}

}  // namespace
}  // namespace granary
