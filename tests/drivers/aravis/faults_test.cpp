// Cables pulled, cameras held, packets lost: always a DeviceError in bounded time, and frames again afterwards.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <memory>
#include <thread>

#include "tests/drivers/aravis/aravis_test.h"

namespace granary {
namespace {

using testing::HasSubstr;
class Fault : public AravisTest {};

struct Unref {
  void operator()(gpointer object) const { g_object_unref(object); }
};
using Holder = std::unique_ptr<ArvCamera, Unref>;

TEST_F(Fault, HeldByAnotherProgramIsInUseUntilItLetsGo) {
  const FakeGige fake;
  Holder holder(arv_camera_new("127.0.0.1", nullptr));
  ASSERT_TRUE(holder);
  const Refusal refusal = RefusalOf(AravisOptions());
  EXPECT_EQ(refusal.reason, Reason::kCameraInUse);
  EXPECT_THAT(refusal.words, HasSubstr("another program holds it"));
  holder.reset();
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
}

TEST_F(Fault, HeldByAProgramOnAnotherHostSaysWhich) {
  FakeGige fake;
  const Holder holder(arv_camera_new("127.0.0.1", nullptr));
  fake.SetRegister(0x0a14, 0xc0a80764);
  EXPECT_THAT(RefusalOf(AravisOptions()).words, HasSubstr("192.168.7.100"));
}

// Takes control as a program would that dies at once: its heartbeat never comes.
void TakeControlAndDie() {
  const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in camera{};
  camera.sin_family = AF_INET;
  camera.sin_port = htons(3956);
  inet_pton(AF_INET, "127.0.0.1", &camera.sin_addr);
  // GVCP: WRITEREG with an acknowledge, one register: control channel privilege = control.
  const std::array<unsigned char, 16> packet{0x42, 0x01, 0, 0x82, 0, 8, 0, 1, 0, 0, 0x0a, 0, 0, 0, 0, 2};
  std::array<unsigned char, 64> answer{};
  sendto(socket, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&camera), sizeof camera);
  EXPECT_GT(recv(socket, answer.data(), answer.size(), 0), 0);
  close(socket);
}

TEST_F(Fault, HeldByAProgramThatDiedIsWaitedFor) {
  const FakeGige fake;
  TakeControlAndDie();
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
}

TEST_F(Fault, PulledWhileIdleIsFoundByArmAndCuredByReopening) {
  auto fake = std::make_unique<FakeGige>();
  {
    CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
    (void)Shoot(camera);
    fake.reset();
    EXPECT_EQ(ErrorOf([&] { camera.Arm(); }).reason, Reason::kCameraUnavailable);
    camera.Disarm();
  }
  EXPECT_EQ(RefusalOf(AravisOptions()).reason, Reason::kCameraUnavailable);
  fake = std::make_unique<FakeGige>();
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
}

TEST_F(Fault, PulledWhileArmedGivesNoFrameAndIsFoundByTheNextCall) {
  auto fake = std::make_unique<FakeGige>();
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  camera.Arm();
  fake.reset();
  const Refusal grab = ErrorOf([&] { (void)camera.Grab(kShort); });
  EXPECT_TRUE(grab.reason == Reason::kFrameMissing || grab.reason == Reason::kCameraUnavailable) << grab.words;
  EXPECT_EQ(ErrorOf([&] { camera.Trigger(); }).reason, Reason::kCameraUnavailable);
}

TEST_F(Fault, PulledWhileGrabbingEndsTheGrab) {
  auto fake = std::make_unique<FakeGige>();
  CameraAravis camera(AravisOptions(), TriggerMode::kLine0, kSize);
  camera.Arm();
  std::thread puller([&] {
    std::this_thread::sleep_for(milliseconds(100));
    fake.reset();
  });
  const Refusal grab = ErrorOf([&] { (void)camera.Grab(std::chrono::hours(1)); });
  puller.join();
  EXPECT_EQ(grab.reason, Reason::kCameraUnavailable);
  EXPECT_THAT(grab.words, HasSubstr("control of the camera was lost"));
  EXPECT_EQ(ErrorOf([&] { camera.Arm(); }).reason, Reason::kCameraUnavailable);
}

TEST_F(Fault, RestartedBetweenTwoShotsIsFoundByArm) {
  auto fake = std::make_unique<FakeGige>();
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  (void)Shoot(camera);
  fake.reset();
  fake = std::make_unique<FakeGige>();
  const Refusal arm = ErrorOf([&] { camera.Arm(); });
  EXPECT_EQ(arm.reason, Reason::kCameraUnavailable);
}

class PacketLoss : public AravisTest, public testing::WithParamInterface<double> {};

TEST_P(PacketLoss, NeverMakesAFrameThatIsNotWhole) {
  AravisTest::SetUp();
  FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, cv::Size(640, 480));
  fake.LosePackets(GetParam());
  int whole = 0, missing = 0;
  for (int shot = 0; shot < 40; ++shot) {
    const Refusal refusal = ErrorOf([&] {
      const Frame frame = Shoot(camera, milliseconds(1000));
      EXPECT_TRUE(IsWhole(frame.image, 1)) << shot;
      EXPECT_EQ(FrameNumber(frame.image), shot);
      ++whole;
    });
    missing += refusal.reason == Reason::kFrameMissing;
    EXPECT_TRUE(refusal.reason == Reason::kOk || refusal.reason == Reason::kFrameMissing) << refusal.words;
  }
  EXPECT_EQ(whole + missing, 40);
  EXPECT_GT(missing, 0);
  fake.LosePackets(0);
  EXPECT_TRUE(IsWhole(ShootUntilItComes(camera).image, 1));
}
// 41 packets a frame: a third of the frames is broken at 1 %, all but every tenth thousandth at 20 %.
INSTANTIATE_TEST_SUITE_P(Shares, PacketLoss, testing::Values(0.01, 0.2));

TEST_F(Fault, LostPacketsAreCounted) {
  FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, cv::Size(640, 480));
  fake.LosePackets(0.5);
  for (;;) {
    const Refusal refusal = ErrorOf([&] { (void)Shoot(camera, milliseconds(1000)); });
    ASSERT_EQ(refusal.reason, Reason::kFrameMissing);
    if (refusal.words.find("broken") == std::string::npos) continue;  // not one packet came
    EXPECT_THAT(refusal.words, HasSubstr("packets missing of 41 a frame"));
    return;
  }
}

TEST_F(Fault, OneCameraSilentLeavesTheOtherAlone) {
  const FakeGige left({.address = "127.0.0.1", .serial = "L"});
  auto right = std::make_unique<FakeGige>(FakeGige::Options{.address = "127.0.0.2", .serial = "R"});
  CameraAravis left_camera(AravisOptions("127.0.0.1"), TriggerMode::kSoftware, kSize);
  CameraAravis right_camera(AravisOptions("127.0.0.2"), TriggerMode::kSoftware, kSize);
  right->LosePackets(1);
  left_camera.Arm();
  right_camera.Arm();
  left_camera.Trigger();
  right_camera.Trigger();
  EXPECT_TRUE(IsWhole(left_camera.Grab(kLong).image, 1));
  EXPECT_EQ(ErrorOf([&] { (void)right_camera.Grab(kShort); }).reason, Reason::kFrameMissing);
}

}  // namespace
}  // namespace granary
