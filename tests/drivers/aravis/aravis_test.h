// What the tests of the Aravis driver have in common.
#pragma once

#include <chrono>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/camera_aravis.h"
#include "drivers/errors.h"
#include "tests/drivers/aravis/fake_gige.h"

namespace granary {

/// Skips where there is no network namespace to be had.
class AravisTest : public testing::Test {
 protected:
  void SetUp() override;
};

using std::chrono::milliseconds;
/// Long enough for any frame, on a machine however busy.
constexpr milliseconds kLong{5000};
/// Long enough to see that none comes.
constexpr milliseconds kShort{300};
inline const cv::Size kSize(320, 240);

[[nodiscard]] CameraOptions AravisOptions(const std::string& id = "127.0.0.1");

/// One software-triggered frame.
[[nodiscard]] Frame Shoot(CameraAravis& camera, milliseconds timeout = kLong);
/// A frame, after however many lost ones; the tests' own timeout ends it.
[[nodiscard]] Frame ShootUntilItComes(CameraAravis& camera);

/// The error of opening a camera; empty reason and words when it opens.
struct Refusal {
  Reason reason = Reason::kOk;
  std::string words;
};
[[nodiscard]] Refusal RefusalOf(const CameraOptions& options, TriggerMode trigger = TriggerMode::kSoftware,
                                cv::Size size = kSize);
/// The error of anything that may throw DeviceError.
template <typename Call>
[[nodiscard]] Refusal ErrorOf(const Call& call) {
  try {
    call();
    return {};
  } catch (const DeviceError& error) {
    return {error.reason(), error.what()};
  }
}

}  // namespace granary
