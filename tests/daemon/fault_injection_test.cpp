// Ten thousand faults in cameras and projector, on a clock that goes when told: not one number may come of a pair that
// is incomplete or does not belong together, and after each fault the bin is measured again.
//
// The cameras are simulated at the level of the drivers' contract. Every frame says in its pixels which pulse it shows,
// so that the stand-in for the pipeline knows the truth about a pair that the rig let through.
#include <gtest/gtest.h>

#include <array>
#include <deque>
#include <map>
#include <random>
#include <string>

#include "daemon/bin_monitor.h"
#include "tests/daemon/fakes.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using namespace std::chrono_literals;

constexpr int kFaults = 3'400;  // in each of three ways to tell the time

enum class Fault {
  kNone,
  kFrameMissing,       // a camera gives no frame
  kFrameOfOtherPulse,  // an old frame, late in a buffer, comes as if it were this pulse's
  kFrameTwice,         // the frame before once more
  kFrameTorn,          // the driver says that packets are missing
  kNoPixels,
  kLate,             // exposed well after the other
  kOutsideThePulse,  // exposed before the light was on
  kTriggerStorm,     // both cameras count triggers that nobody gave
  kArmFails,         // the control connection is lost
  kGone,             // pulled: everything fails, opening too, for some seconds
  kInUse,            // another program took the camera while it was reopened
  kProjectorFails,
  kProjectorDark,  // the lamp is dead
  kCount
};

const char* const kNames[] = {"none",      "frame missing", "frame of another pulse", "frame twice",   "frame torn",
                              "no pixels", "late",          "outside the pulse",      "trigger storm", "arm fails",
                              "gone",      "in use",        "projector fails",        "projector dark"};
static_assert(std::size(kNames) == static_cast<std::size_t>(Fault::kCount));

/// How the cameras tell the time: each must be enough to catch what does not belong together.
enum class Timing { kHostClock, kOwnClock, kCounterOnly };

/// The world the rig looks at.
struct World {
  FakeClock& clock;
  Timing timing;
  Fault fault = Fault::kNone;
  std::size_t side = 0;     ///< of the camera that has the fault
  UtcTime back_at{};        ///< when a device that is gone comes back
  std::uint32_t pulse = 0;  ///< number of the last pulse
  UtcTime pulse_at{}, pulse_before_at{};
  bool lit = false;
  std::array<std::uint64_t, 2> ids{};
  std::mt19937 random{7};
  [[nodiscard]] bool Gone() const { return (fault == Fault::kGone || fault == Fault::kInUse) && clock.Now() < back_at; }
};

class TellingCamera final : public Camera {
 public:
  TellingCamera(std::shared_ptr<World> world, std::size_t side) : world_(std::move(world)), side_(side) {
    if (world_->side != side_ || !world_->Gone()) return;
    throw DeviceError(world_->fault == Fault::kInUse ? Reason::kCameraInUse : Reason::kCameraUnavailable, Id(), "open",
                      "as the test wants it");
  }
  [[nodiscard]] std::string Id() const override { return side_ == 0 ? "left" : "right"; }
  void Arm() override {
    if (Has(Fault::kArmFails)) Fail(Reason::kCameraUnavailable, "arm");
    if (world_->side == side_ && world_->Gone()) Fail(Reason::kCameraUnavailable, "arm");
  }
  [[nodiscard]] Frame Grab(std::chrono::milliseconds) override {
    if (world_->side == side_ && world_->Gone()) Fail(Reason::kCameraUnavailable, "grab");
    if (Has(Fault::kFrameMissing)) Fail(Reason::kFrameMissing, "grab");
    if (Has(Fault::kFrameTorn)) Fail(Reason::kFrameMissing, "grab: 3 of 900 packets are missing");
    if (Has(Fault::kFrameTwice) && last_) return *last_;
    // By counters alone a camera that lags by one pulse from its opening on looks like one that does not: there it is
    // the emptying of its buffers at Arm that drops the late frame.
    if (Has(Fault::kFrameOfOtherPulse) && world_->timing == Timing::kCounterOnly && !last_)
      Fail(Reason::kFrameMissing, "grab");
    Frame frame = Expose();
    if (Has(Fault::kNoPixels)) frame.image.release();
    last_ = frame;
    return frame;
  }
  void Disarm() noexcept override {}
  void Interrupt() noexcept override {}

 private:
  [[nodiscard]] bool Has(Fault fault) const { return world_->fault == fault && world_->side == side_; }
  [[noreturn]] void Fail(Reason reason, const std::string& operation) const {
    throw DeviceError(reason, Id(), operation, "as the test wants it");
  }
  Frame Expose() {
    std::uint32_t pulse = world_->pulse;
    UtcTime at = world_->pulse_at + 30us;
    bool lit = world_->lit;
    std::uint64_t id = (world_->ids.at(side_) += world_->fault == Fault::kTriggerStorm ? 4 : 1);
    if (Has(Fault::kFrameOfOtherPulse)) {
      pulse -= 1;
      at = world_->pulse_before_at + 30us;
      id -= 1;
    }
    if (Has(Fault::kLate)) at += 1500us;
    if (Has(Fault::kOutsideThePulse)) {
      at -= 40ms;
      lit = false;
    }
    Frame frame;
    // The pulse's number and whether it was lit, in the pixels.
    frame.image = cv::Mat(1, 3, CV_16UC1);
    frame.image.at<std::uint16_t>(0, 0) = static_cast<std::uint16_t>(pulse >> 16);
    frame.image.at<std::uint16_t>(0, 1) = static_cast<std::uint16_t>(pulse);
    frame.image.at<std::uint16_t>(0, 2) = lit ? 1 : 0;
    frame.bit_depth = 16;
    frame.frame_id = world_->timing == Timing::kCounterOnly ? id : 0;
    frame.source = Id();
    if (world_->timing == Timing::kHostClock) {
      frame.exposure_start = at;
      frame.exposure_end = at + 8ms;
    }
    if (world_->timing == Timing::kOwnClock) {
      frame.device_time = at.time_since_epoch() - (side_ == 0 ? 3h : 11h);
    }
    return frame;
  }

  std::shared_ptr<World> world_;
  std::size_t side_;
  std::optional<Frame> last_;
};

class TellingProjector final : public Projector {
 public:
  explicit TellingProjector(std::shared_ptr<World> world) : world_(std::move(world)) {}
  LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>& lit) override {
    if (world_->fault == Fault::kProjectorFails)
      throw DeviceError(Reason::kProjectorFault, "projector", "set", "as the test wants it");
    // Two pulses are never equally far from the ones before: the program's own time differs by milliseconds.
    world_->clock.Advance(50ms + std::chrono::milliseconds(world_->random() % 20));
    ++world_->pulse;
    world_->pulse_before_at = world_->pulse_at;
    world_->pulse_at = world_->clock.Now();
    world_->lit = world_->fault != Fault::kProjectorDark;
    if (lit) lit();
    return {world_->pulse_at, world_->pulse_at + width};
  }

 private:
  std::shared_ptr<World> world_;
};

struct Told {
  std::uint32_t pulse = 0;
  bool lit = false;
};
Told Read(const Frame& frame) {
  const auto* told = frame.image.ptr<std::uint16_t>();
  return {static_cast<std::uint32_t>(told[0]) << 16 | told[1], told[2] == 1};
}

class FaultInjection : public ::testing::TestWithParam<Timing> {
 protected:
  BinSetup MakeSetup() {
    BinSetup setup;
    setup.bin.id = 1;
    setup.bin.name = "bay-1";
    setup.schedule.every = 30min;
    setup.cycle.attempts = 2;
    setup.cycle.retry_delay = 2s;
    setup.rigs.emplace_back().options.projector.driver = ProjectorDriver::kGpio;
    setup.measure = [this](const std::vector<Shot>& shots, const Inventory&) { return Measure(shots.front().front()); };
    return setup;
  }

  /// What the pipeline makes of a pair; it sees a dead lamp, as the speckle is missing, but cannot see that a pair does
  /// not belong together.
  Measurement Measure(const FramePair& pair) {
    const Told left = Read(pair.left), right = Read(pair.right);
    if (left.pulse != right.pulse || left.pulse != world->pulse) {
      ++bad_pairs;
      ADD_FAILURE() << "a pair of pulses " << left.pulse << " and " << right.pulse << " after pulse " << world->pulse
                    << " with the fault: " << kNames[static_cast<std::size_t>(world->fault)];
    }
    if (!left.lit || !right.lit) return Verdict(Reason::kProjectorDark);
    return Valid(0.019 + 1e-9 * left.pulse);
  }

  RigOpener Opener() {
    return [this](const RigOptions&, const RigWorld&) {
      CaptureOptions options;
      options.trigger = {TriggerMode::kLine0, TriggerMode::kLine0};
      options.warmup_pairs = 1;
      return Rig(
          std::make_unique<TellingCamera>(world, 0), std::make_unique<TellingCamera>(world, 1),
          std::make_unique<TellingProjector>(world), options, [this] { return clock.Now(); },
          [this] { return clock.Steady(); });
    };
  }

  TemporaryFolder folder;
  FakeClock clock;
  FakePublisher publisher;
  std::stop_source stop;
  std::shared_ptr<World> world = std::make_shared<World>(World{clock, GetParam()});
  int bad_pairs = 0;
};

TEST_P(FaultInjection, GivesNoNumberOfABadPairAndMeasuresAgainWithinAMinute) {
  std::mt19937 random(20261122);
  Records records{folder.path(), clock};
  BinMonitor monitor(MakeSetup(), records, {&publisher}, clock, Opener());
  monitor.Restore();
  std::map<Reason, int> reasons;
  int recovered = 0, slowest_s = 0, silent = 0;
  for (int i = 0; i < kFaults; ++i) {
    const auto fault = static_cast<Fault>(1 + random() % (static_cast<unsigned>(Fault::kCount) - 1));
    world->fault = fault;
    world->side = random() % 2;
    world->back_at = clock.Now() + std::chrono::seconds(1 + random() % 90);
    const auto before = publisher.snapshots.empty() ? std::nullopt : publisher.snapshots.back().good;
    publisher.snapshots.clear();

    ASSERT_TRUE(monitor.RunCycle(stop.get_token()));
    const BinSnapshot during = publisher.snapshots.back();
    if (during.last->valid) {
      // A fault that ended by itself (a retry with a new pair) is none; it must be this pulse's figure.
      ASSERT_EQ(*during.good->volume_m3, 0.019 + 1e-9 * world->pulse) << kNames[static_cast<std::size_t>(fault)];
      ++silent;
    } else {
      ++reasons[during.last->reason];
      ASSERT_FALSE(during.last->volume_m3) << kNames[static_cast<std::size_t>(fault)];
      ASSERT_FALSE(during.last->detail.empty() && during.last->reason == Reason::kInternal);
      if (before) {
        ASSERT_TRUE(during.held);
        ASSERT_EQ(during.good->volume_m3, before->volume_m3) << "the held figure changed";
        ASSERT_EQ(during.good->utc, before->utc) << "the held figure changed its time";
      }
    }

    // The fault ends; a device that is gone ends it by itself.
    if (fault != Fault::kGone && fault != Fault::kInUse) world->fault = Fault::kNone;
    while (world->Gone()) {
      clock.Advance(1s);
      monitor.Idle(std::nullopt);
      ASSERT_FALSE(monitor.TryAgain(stop.get_token()) && world->Gone());
    }
    world->fault = Fault::kNone;
    if (during.last->valid || publisher.snapshots.back().last->valid) continue;
    int seconds = 0;
    for (bool measured = false; !measured; ++seconds) {
      ASSERT_LE(seconds, 60) << kNames[static_cast<std::size_t>(fault)];
      clock.Advance(1s);
      monitor.Idle(std::nullopt);
      measured = monitor.TryAgain(stop.get_token());
    }
    ASSERT_EQ(*publisher.snapshots.back().good->volume_m3, 0.019 + 1e-9 * world->pulse);
    slowest_s = std::max(slowest_s, seconds);
    ++recovered;
  }
  EXPECT_EQ(bad_pairs, 0);
  std::string line;
  for (const auto& [reason, count] : reasons)
    line += " " + std::string(InfoOf(reason).name) + " " + std::to_string(count);
  std::printf(
      "%d faults: 0 numbers from bad pairs; %d measured again after at most %d s, %d overcome within the cycle;%s\n",
      kFaults, recovered, slowest_s, silent, line.c_str());
}

std::string NameOf(const ::testing::TestParamInfo<Timing>& test) {
  static constexpr const char* kTimings[] = {"HostClock", "OwnClock", "CounterOnly"};
  return kTimings[static_cast<std::size_t>(test.param)];
}

INSTANTIATE_TEST_SUITE_P(Timings, FaultInjection,
                         ::testing::Values(Timing::kHostClock, Timing::kOwnClock, Timing::kCounterOnly), NameOf);

}  // namespace
}  // namespace granary
