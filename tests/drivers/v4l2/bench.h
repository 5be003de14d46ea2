// A camera over a fake node.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/camera_v4l2.h"
#include "drivers/errors.h"
#include "tests/drivers/v4l2/fake_v4l2.h"

namespace granary {

inline constexpr std::chrono::milliseconds kTimeout{500};
inline const std::string kPath = "/dev/video-of-the-test";

inline CameraOptions Options() {
  CameraOptions options;
  options.driver = CameraDriver::kV4l2;
  options.id = kPath;
  return options;
}

inline FakeControl ExposureControl() { return {"Exposure Time, Absolute", V4L2_CTRL_TYPE_INTEGER, 1, 5000, 1, 157}; }

struct V4l2Bench {
  std::unique_ptr<CameraV4l2> Open(TriggerMode trigger, const CameraOptions& options = Options()) {
    return std::make_unique<CameraV4l2>(options, trigger, cv::Size(), system);
  }
  // Frames of these greys arrive one after the other while somebody waits.
  void WillSend(const std::vector<int>& greys) const {
    for (const int grey : greys) node->to_come.emplace_back([grey](FakeNode& n) { n.SendGrey(grey); });
  }
  UtcTime Utc(std::chrono::nanoseconds monotonic) { return system.Utc() - system.now + monotonic; }
  FakeV4l2 system;
  std::shared_ptr<FakeNode> node = system.Plug(kPath);
};

inline Reason ReasonOf(const std::function<void()>& call) {
  try {
    call();
    return Reason::kOk;
  } catch (const DeviceError& error) {
    return error.reason();
  }
}

inline std::string WordsOf(const std::function<void()>& call) {
  try {
    call();
    return "nothing was thrown";
  } catch (const DeviceError& error) {
    return error.what();
  }
}

inline int GreyOf(const Frame& frame) { return frame.image.at<std::uint8_t>(0, 0); }

}  // namespace granary
