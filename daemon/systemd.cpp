// The watchdog is fed by the measuring, not by the main loop: a daemon whose worker hangs is started anew.
#include "daemon/systemd.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <systemd/sd-daemon.h>

#include <chrono>
#include <cstring>

#include "daemon/fault_log.h"
#include "daemon/record_json.h"

namespace granary {

void NotifySystemd(const std::string& state) {
  static FaultLog fault_log;
  const int result = sd_notify(0, state.c_str());
  if (result >= 0) {
    fault_log.Clear();
  } else if (fault_log.Raise(std::strerror(-result), std::chrono::steady_clock::now())) {
    spdlog::error("systemd: sd_notify: {}", std::strerror(-result));
  }
}

std::string ReloadingState() {
  using std::chrono::microseconds;
  const auto now = std::chrono::duration_cast<microseconds>(std::chrono::steady_clock::now().time_since_epoch());
  return fmt::format("RELOADING=1\nMONOTONIC_USEC={}\nSTATUS=reading the configuration anew", now.count());
}

std::string StatusText(const std::vector<BinSnapshot>& snapshots) {
  std::string text;
  for (const auto& s : snapshots) {
    if (!text.empty()) text += "; ";
    text += fmt::format("bin {} {}: ", s.bin.id, s.bin.name);
    text += s.good && s.good->volume_m3 ? fmt::format("{:.5g} m³", *s.good->volume_m3) : std::string("no figure yet");
    if (s.held) text += " held";
    if (s.last && !s.last->valid) text += fmt::format(" ({})", InfoOf(s.last->reason).name);
    if (s.measuring) {
      text += ", measuring";
    } else if (s.next_at) {
      text += ", next " + UtcText(*s.next_at);
    }
  }
  return text;
}

std::string TickState(bool progress, const std::vector<BinSnapshot>& snapshots) {
  return (progress ? "WATCHDOG=1\nSTATUS=" : "STATUS=a worker hangs: ") + StatusText(snapshots);
}

}  // namespace granary
