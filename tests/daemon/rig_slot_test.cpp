#include "daemon/rig_slot.h"

#include <gtest/gtest.h>

#include "tests/daemon/fakes.h"

namespace granary {
namespace {

using namespace std::chrono_literals;

struct Place {
  FakeClock clock;
  std::shared_ptr<FakeBench> bench = std::make_shared<FakeBench>();
  RigSlot slot{{}, FakeOpener(bench, clock), clock};

  /// The reason of one capture.
  Reason Capture() {
    try {
      static_cast<void>(slot.Capture());
      return Reason::kOk;
    } catch (const DeviceError& error) {
      return error.reason();
    }
  }
};

TEST(ReopenDelay, GrowsFromOneSecondToHalfAMinute) {
  std::vector<long> seconds;
  for (const int failures : {0, 1, 2, 3, 6, 7, 8, 1000}) seconds.push_back(ReopenDelay(failures).count());
  EXPECT_EQ(seconds, (std::vector<long>{0, 1, 2, 4, 30, 30, 30, 30}));
}

TEST(RigSlot, OpensOnceForManyCaptures) {
  Place place;
  EXPECT_EQ(place.Capture(), Reason::kOk);
  EXPECT_EQ(place.Capture(), Reason::kOk);
  EXPECT_EQ(place.bench->opens, 1);
}

TEST(RigSlot, ClosesTheDevicesOnTrouble) {
  Place place;
  place.bench->failing_grabs = 1;
  EXPECT_EQ(place.Capture(), Reason::kFrameMissing);
  EXPECT_EQ(place.bench->closes, 2);
}

TEST(RigSlot, OpensAheadOfTheFirstCapture) {
  Place place;
  place.slot.Open();
  place.slot.Open();
  EXPECT_EQ(place.Capture(), Reason::kOk);
  EXPECT_EQ(place.bench->opens, 1);
}

TEST(RigSlot, ReopensWhenTheDelayIsOver) {
  Place place;
  place.bench->failing_grabs = 1;
  EXPECT_EQ(place.Capture(), Reason::kFrameMissing);
  place.clock.Advance(1s);
  EXPECT_EQ(place.Capture(), Reason::kOk);
  EXPECT_EQ(place.bench->opens, 2);
}

TEST(RigSlot, RepeatsTheTroubleWithoutTouchingDevicesUntilThen) {
  Place place;
  place.bench->failing_opens = 1;
  EXPECT_EQ(place.Capture(), Reason::kCameraUnavailable);
  place.clock.Advance(999ms);
  EXPECT_EQ(place.Capture(), Reason::kCameraUnavailable);
  EXPECT_EQ(place.bench->opens, 1);
}

TEST(RigSlot, WaitsLongerAfterEachFailure) {
  Place place;
  place.bench->failing_opens = 2;
  EXPECT_EQ(place.Capture(), Reason::kCameraUnavailable);
  place.clock.Advance(1s);
  EXPECT_EQ(place.Capture(), Reason::kCameraUnavailable);
  place.clock.Advance(1s);
  EXPECT_EQ(place.Capture(), Reason::kCameraUnavailable);
  EXPECT_EQ(place.bench->opens, 2);
}

TEST(RigSlot, ReopensBetweenCycles) {
  Place place;
  place.bench->failing_grabs = 1;
  EXPECT_EQ(place.Capture(), Reason::kFrameMissing);
  EXPECT_FALSE(place.slot.ReopenIfDue());
  place.clock.Advance(1s);
  EXPECT_TRUE(place.slot.ReopenIfDue());
  EXPECT_FALSE(place.slot.ReopenIfDue());
}

TEST(RigSlot, DoesNotOpenARigThatWasNeverWanted) {
  Place place;
  EXPECT_FALSE(place.slot.ReopenIfDue());
  EXPECT_EQ(place.bench->opens, 0);
}

TEST(RigSlot, DoesNotForgetTheDelayWhenOpeningAloneSucceeds) {
  Place place;
  place.bench->failing_grabs = 2;
  EXPECT_EQ(place.Capture(), Reason::kFrameMissing);
  place.clock.Advance(1s);
  EXPECT_TRUE(place.slot.ReopenIfDue());
  EXPECT_EQ(place.Capture(), Reason::kFrameMissing);
  place.clock.Advance(1s);
  EXPECT_FALSE(place.slot.ReopenIfDue());
}

}  // namespace
}  // namespace granary
