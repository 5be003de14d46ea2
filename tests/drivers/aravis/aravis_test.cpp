// The namespace has to be entered before there is a second thread, and Aravis starts some: hence a main of our own.
#include "tests/drivers/aravis/aravis_test.h"

#include "tests/loopback/network_namespace.h"

namespace granary {

void AravisTest::SetUp() {
  const std::string why_not = EnterNetworkNamespace();
  if (!why_not.empty()) GTEST_SKIP() << why_not;
}

CameraOptions AravisOptions(const std::string& id) {
  CameraOptions options;
  options.driver = CameraDriver::kAravis;
  options.id = id;
  // Without CAP_NET_RAW the stream has a plain socket, and packets of the fake's own size overrun it.
  options.packet_size = 8000;
  return options;
}

Frame Shoot(CameraAravis& camera, milliseconds timeout) {
  camera.Arm();
  camera.Trigger();
  Frame frame = camera.Grab(timeout);
  camera.Disarm();
  return frame;
}

Frame ShootUntilItComes(CameraAravis& camera) {
  for (;;) {
    try {
      return Shoot(camera, milliseconds(1000));
    } catch (const DeviceError& error) {
      if (error.reason() != Reason::kFrameMissing) throw;
    }
  }
}

Refusal RefusalOf(const CameraOptions& options, TriggerMode trigger, cv::Size size) {
  return ErrorOf([&] { const CameraAravis camera(options, trigger, size); });
}

}  // namespace granary

int main(int argc, char** argv) {
  granary::EnterNetworkNamespace();
  testing::InitGoogleMock(&argc, argv);
  return RUN_ALL_TESTS();
}
