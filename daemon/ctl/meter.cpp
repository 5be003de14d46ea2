// granaryctl meter: pairs from the rig without end, with what an engineer looks at while lenses, lamp and cables are
// set up. A rig in trouble is opened again and again, so that a cable may be pulled and put back.
#include <CLI/CLI.hpp>

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include <opencv2/core.hpp>

#include "daemon/ctl/command.h"
#include "daemon/ctl/meter.h"
#include "daemon/ctl/setup.h"
#include "daemon/ctl/stop_signals.h"
#include "drivers/errors.h"
#include "drivers/rig.h"
#include "pipeline/quality.h"
#include "pipeline/rectify.h"

namespace granary {

std::string MeterHeader() {
  return "pairs/s skew us pulse us contrast %    grey %      full %   lost  odd  deg C\n"
         "                         left right  left right left right  l  r";
}

std::string MeterLine(const MeterReading& reading) {
  const auto number = [](const std::optional<double>& value, int width, int decimals) -> std::string {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), "%*s", width, "-");
    if (value) std::snprintf(text.data(), text.size(), "%*.*f", width, decimals, *value);
    return text.data();
  };
  const auto percent = [&](double PictureQuality::*figure, int width) {
    return number(100 * reading.left.*figure, width, 1) + number(100 * reading.right.*figure, 6, 1);
  };
  const auto count = [&](std::uint64_t value, int width) { return number(static_cast<double>(value), width, 0); };
  return number(reading.pairs_per_s, 7, 1) + number(reading.skew_us, 8, 0) + number(reading.pulse_us, 9, 0) +
         percent(&PictureQuality::speckle_contrast, 5) + percent(&PictureQuality::mean_fraction, 6) +
         percent(&PictureQuality::saturated_fraction, 5) + count(reading.counters.missed_frames[0], 3) +
         count(reading.counters.missed_frames[1], 3) + count(reading.counters.mismatched, 5) +
         number(reading.temperature_c, 7, 1);
}

namespace {

using Clock = std::chrono::steady_clock;

struct MeterArguments {
  std::string rig;
  double every_s = 0.5;
  std::uint64_t count = 0;
};

nlohmann::ordered_json ToJson(const MeterReading& reading) {
  const auto side = [](const PictureQuality& quality) {
    return nlohmann::ordered_json{{"speckle_contrast", quality.speckle_contrast},
                                  {"mean_fraction", quality.mean_fraction},
                                  {"saturated_fraction", quality.saturated_fraction}};
  };
  return {{"pairs_per_s", OrNull(reading.pairs_per_s)},
          {"skew_us", OrNull(reading.skew_us)},
          {"pulse_us", OrNull(reading.pulse_us)},
          {"temperature_c", OrNull(reading.temperature_c)},
          {"left", side(reading.left)},
          {"right", side(reading.right)},
          {"missed_left", reading.counters.missed_frames[0]},
          {"missed_right", reading.counters.missed_frames[1]},
          {"mismatched", reading.counters.mismatched}};
}

/// The terminal's last line, written over while all is well.
class LiveLine {
 public:
  void Show(const std::string& line) {
    if (!terminal_) return Say(line);
    std::fprintf(stderr, "\r\033[K%s", line.c_str());
    open_ = true;
  }
  /// Stays, and what follows begins a new line.
  void Keep(const std::string& line) {
    if (open_) std::fputs("\n", stderr);
    open_ = false;
    Say(line);
  }
  void End() {
    if (open_) std::fputs("\n", stderr);
    open_ = false;
  }

 private:
  bool terminal_ = isatty(STDERR_FILENO) != 0;
  bool open_ = false;
};

/// A pause that leaves the projector within its duty limit.
Clock::duration Pause(const RigOptions& rig, double every_s) {
  const std::chrono::duration<double> wanted(every_s);
  if (rig.projector.driver != ProjectorDriver::kGpio) return std::chrono::duration_cast<Clock::duration>(wanted);
  const std::chrono::duration<double> allowed = PulseWidth(rig) * (1.1 * 100 / rig.projector.max_duty_percent);
  return std::chrono::duration_cast<Clock::duration>(std::max(wanted, allowed));
}

MeterReading Read(const FramePair& pair, const Rectification& rectification) {
  MeterReading reading;
  if (pair.skew) reading.skew_us = static_cast<double>(pair.skew->count());
  if (pair.pulse) reading.pulse_us = static_cast<double>(pair.pulse->count());
  for (const Frame* frame : {&pair.left, &pair.right}) {
    if (frame->temperature_c)
      reading.temperature_c = std::max(reading.temperature_c.value_or(*frame->temperature_c), *frame->temperature_c);
  }
  if (const std::string fault = FrameFault(pair, rectification.size); !fault.empty()) {
    throw DeviceError(Reason::kFrameInvalid, pair.left.source, "look at the pair", fault);
  }
  const RectifiedPair rectified = RectifyPair(pair, rectification);
  reading.left = AssessPicture(rectified.left, rectification.left_inside);
  reading.right = AssessPicture(rectified.right, rectification.right_inside);
  return reading;
}

int Meter(const GlobalOptions& global, const MeterArguments& arguments) {
  const ChosenBin bin = ChooseBin(global, arguments.rig);
  const ChosenRig& chosen = OnlyRig(bin);
  const Rectification rectification = ComputeRectification(chosen.setup.calibration);
  const Clock::duration pause = Pause(chosen.options, arguments.every_s);
  Say("bin " + std::to_string(bin.config.bin.id) + ", rig " + chosen.options.name +
      (chosen.Simulated() ? " (simulated)" : "") + ": a pair every " +
      std::to_string(std::chrono::duration_cast<std::chrono::milliseconds>(pause).count()) + " ms, Ctrl-C ends it");
  Say(MeterHeader());

  LiveLine out;
  std::optional<Rig> rig;
  RigCounters before;        // of the rigs that were closed
  Clock::time_point last{};  // of a pair; none since trouble
  MeterReading reading;
  std::string trouble;
  for (std::uint64_t pairs = 0; arguments.count == 0 || pairs < arguments.count; ++pairs) {
    const auto next = Clock::now() + pause;
    try {
      FramePair pair;
      {
        const CaptureGuard guard;
        if (!rig) rig.emplace(OpenRig(chosen.options, WorldOf(bin, chosen)));
        pair = rig->CapturePair();
      }
      reading = Read(pair, rectification);
      const auto now = Clock::now();
      if (last != Clock::time_point{}) reading.pairs_per_s = 1 / std::chrono::duration<double>(now - last).count();
      last = now;
      reading.counters = before;
      reading.counters += rig->counters();
      trouble.clear();
      out.Show(MeterLine(reading));
    } catch (const DeviceError& error) {
      if (rig) before += rig->counters();
      rig.reset();
      last = {};
      if (trouble != error.what()) out.Keep(std::string(InfoOf(error.reason()).name) + ": " + error.what());
      trouble = error.what();
    }
    std::this_thread::sleep_until(trouble.empty() ? next : next + std::chrono::seconds(1));
  }
  out.End();
  if (global.json) PrintJson(trouble.empty() ? ToJson(reading) : nlohmann::ordered_json{{"error", trouble}});
  return trouble.empty() ? kExitDone : kExitFailed;
}

}  // namespace

void AddMeter(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<MeterArguments>();
  CLI::App* command =
      app.add_subcommand("meter", "live rate, skew, pulse, contrast and brightness of the rig's pictures");
  command->add_option("--rig", arguments->rig, "of this rig")->type_name("NAME");
  command
      ->add_option("--every", arguments->every_s, "pause between pairs; never shorter than the projector's duty limit")
      ->check(CLI::Range(0.0, 3600.0))
      ->type_name("SECONDS")
      ->capture_default_str();
  command->add_option("--count", arguments->count, "end after so many pairs, failed ones included; 0: on Ctrl-C")
      ->capture_default_str();
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Meter(global, *arguments); }; });
}

}  // namespace granary
