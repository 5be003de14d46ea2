// How cameras are named and found.
#include "drivers/found_camera.h"
#include "tests/drivers/aravis/aravis_test.h"

namespace granary {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
class FindAravisCameras_ : public AravisTest {};
class OpenAravis : public AravisTest {};

TEST_F(FindAravisCameras_, ListsEachWithTheIdThatTheConfigurationWants) {
  const FakeGige left({.address = "127.0.0.1", .serial = "L"}), right({.address = "127.0.0.2", .serial = "R"});
  const auto cameras = FindAravisCameras();
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_EQ(cameras[0].id, "Aravis-L");
  EXPECT_EQ(cameras[1].id, "Aravis-R");
  EXPECT_THAT(cameras[1].other_ids, Contains("R"));
  EXPECT_THAT(cameras[1].other_ids, Contains("127.0.0.2"));
  EXPECT_EQ(cameras[1].vendor, "Aravis");
  EXPECT_EQ(cameras[1].model, "Fake");
  EXPECT_EQ(cameras[1].serial, "R");
  EXPECT_EQ(cameras[1].address, "127.0.0.2 (lo)");
  EXPECT_THAT(cameras[1].formats, ElementsAre("Mono8", "Mono16"));
  EXPECT_EQ(cameras[1].note, "");
}

TEST_F(FindAravisCameras_, GivesNothingWhereThereIsNone) { EXPECT_TRUE(FindAravisCameras().empty()); }

TEST_F(FindAravisCameras_, SaysOfACameraThatItIsInUseAndLeavesItAlone) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  const auto cameras = FindAravisCameras();
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_EQ(cameras[0].note, "in use by another program");
  EXPECT_THAT(cameras[0].formats, ElementsAre("Mono8", "Mono16"));
  EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
}

TEST_F(OpenAravis, TakesSerialVendorSerialIpAndAravisOwnId) {
  const FakeGige fake({.serial = "GV-77"});
  for (const char* id : {"GV-77", "Aravis-GV-77", "127.0.0.1", "Aravis-Fake-GV-77"}) {
    CameraAravis camera(AravisOptions(id), TriggerMode::kSoftware, kSize);
    EXPECT_TRUE(IsWhole(Shoot(camera).image, 1)) << id;
    EXPECT_EQ(camera.Id(), id);
  }
}

TEST_F(OpenAravis, SaysWhichCamerasAreThereInPlaceOfTheAbsentOne) {
  const FakeGige fake({.serial = "R"});
  const Refusal refusal = RefusalOf(AravisOptions("Aravis-L"));
  EXPECT_EQ(refusal.reason, Reason::kCameraUnavailable);
  EXPECT_THAT(refusal.words, HasSubstr("there are: Aravis-R"));
}

TEST_F(OpenAravis, SaysThatThereIsNoCameraAtAll) {
  const Refusal refusal = RefusalOf(AravisOptions("Aravis-L"));
  EXPECT_EQ(refusal.reason, Reason::kCameraUnavailable);
  EXPECT_THAT(refusal.words, HasSubstr("there is none at all"));
}

TEST_F(OpenAravis, FailsWhereNoCameraHasTheAddress) {
  EXPECT_EQ(RefusalOf(AravisOptions("127.0.0.2")).reason, Reason::kCameraUnavailable);
}

TEST_F(OpenAravis, RefusesAnIdOfTwoCameras) {
  const FakeGige left({.address = "127.0.0.1", .serial = "L"}), right({.address = "127.0.0.2", .serial = "R"});
  // The fakes have no MAC, which names none of them.
  EXPECT_EQ(RefusalOf(AravisOptions("00:00:00:00:00:00")).reason, Reason::kCameraUnavailable);
}

}  // namespace
}  // namespace granary
