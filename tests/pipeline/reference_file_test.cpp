// The stored reference: read back whole, older versions kept, damage found.
#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/file_error.h"
#include "pipeline/reference_file.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

Reference SomeReference(const std::string& id, float height_m) {
  Reference reference;
  reference.id = id;
  reference.rig_hash = "0123456789abcdef";
  reference.utc = UtcTime(std::chrono::nanoseconds(1'795'000'000'123'456'789));
  reference.simulated = true;
  reference.points_in_world = cv::Mat(4, 5, CV_32FC3, cv::Scalar(0.1, 0.2, height_m));
  reference.points_in_world.at<cv::Vec3f>(1, 1) = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
  reference.noise_m = cv::Mat(4, 5, CV_32FC1, cv::Scalar(0.001));
  reference.hash = HashOfPoints(reference.points_in_world);
  return reference;
}

std::string FaultOf(const fs::path& folder) {
  try {
    static_cast<void>(LoadReference(folder));
  } catch (const FileError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no FileError";
  return {};
}

/// Flips one bit `from_end` bytes before the end of `file`.
void Damage(const fs::path& file, std::size_t from_end) {
  std::string bytes = TemporaryFolder::Read(file);
  bytes[bytes.size() - from_end] ^= 1;
  std::ofstream(file, std::ios::binary) << bytes;
}

TEST(SaveReference, ReadsBack) {
  const TemporaryFolder folder;
  const Reference saved = SomeReference("bin1-a-1", 0.001F);
  SaveReference(saved, folder / "not/there/yet");
  const Reference back = LoadReference(folder / "not/there/yet");
  EXPECT_EQ(back.id, saved.id);
  EXPECT_EQ(back.hash, saved.hash);
  EXPECT_EQ(back.rig_hash, saved.rig_hash);
  EXPECT_EQ(back.utc, saved.utc);
  EXPECT_TRUE(back.simulated);
  EXPECT_EQ(HashOfPoints(back.points_in_world), saved.hash);
  EXPECT_EQ(back.noise_m.at<float>(3, 4), 0.001F);
}
TEST(SaveReference, TheNewVersionCountsAndTheOldOneStays) {
  const TemporaryFolder folder;
  SaveReference(SomeReference("old", 0.001F), folder.path());
  SaveReference(SomeReference("new", 0.002F), folder.path());
  EXPECT_EQ(LoadReference(folder.path()).id, "new");
  EXPECT_EQ(LoadReference(folder / "old").id, "old");
  EXPECT_EQ(LoadReference(folder / "old").points_in_world.at<cv::Vec3f>(0, 0)[2], 0.001F);
}
TEST(SaveReference, AFailedSaveLeavesTheOldVersionCurrent) {
  const TemporaryFolder folder;
  SaveReference(SomeReference("old", 0.001F), folder.path());
  folder.Write("new", "a file where a folder is wanted");
  EXPECT_THROW(SaveReference(SomeReference("new", 0.002F), folder.path()), FileError);
  EXPECT_EQ(LoadReference(folder.path()).id, "old");
}
TEST(SaveReference, AnIdThatIsNoNameIsRefused) {
  const TemporaryFolder folder;
  EXPECT_THROW(SaveReference(SomeReference("../elsewhere", 0), folder.path()), FileError);
}
TEST(LoadReference, NoneTakenYetIsSaid) {
  const TemporaryFolder folder;
  EXPECT_FALSE(HasReference(folder.path()));
  EXPECT_THAT(FaultOf(folder.path()), HasSubstr("no reference was taken yet"));
}
TEST(LoadReference, AFlippedBitInTheNoiseIsFound) {
  const TemporaryFolder folder;
  SaveReference(SomeReference("r", 0), folder.path());
  Damage(folder / "r/reference.pcd", 4);
  EXPECT_THAT(FaultOf(folder.path()), HasSubstr("noise figures have the hash"));
}
TEST(LoadReference, AFlippedBitInThePointsIsFound) {
  const TemporaryFolder folder;
  SaveReference(SomeReference("r", 0), folder.path());
  Damage(folder / "r/reference.pcd", 16);
  EXPECT_THAT(FaultOf(folder.path()), HasSubstr("points have the hash"));
}
TEST(LoadReference, ATruncatedCloudIsFound) {
  const TemporaryFolder folder;
  SaveReference(SomeReference("r", 0), folder.path());
  fs::resize_file(folder / "r/reference.pcd", 200);
  EXPECT_THAT(FaultOf(folder.path()), HasSubstr("reference.pcd"));
}
TEST(LoadReference, ADamagedIndexIsFound) {
  const TemporaryFolder folder;
  for (const char* text : {"{", "[]", "{\"id\": 5}", "{}"}) {
    folder.Write("reference.json", text);
    EXPECT_THAT(FaultOf(folder.path()), HasSubstr("reference.json: is damaged")) << text;
  }
  SaveReference(SomeReference("r", 0), folder.path());
  std::string text = TemporaryFolder::Read(folder / "reference.json");
  text.replace(text.find("2026-"), 5, "xxxx-");
  folder.Write("reference.json", text);
  EXPECT_THAT(FaultOf(folder.path()), HasSubstr("utc: "));
}
TEST(ReferenceFolder, KeepsRigNamesInsideTheStateFolder) {
  EXPECT_EQ(ReferenceFolder("/state", 3, "north"), fs::path("/state/reference/bin3/north"));
  for (const char* name : {"", "..", "a/b", ".hidden"}) {
    EXPECT_THROW(static_cast<void>(ReferenceFolder("/state", 1, name)), std::invalid_argument) << name;
  }
}

}  // namespace
}  // namespace granary
