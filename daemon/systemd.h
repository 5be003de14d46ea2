// What the service says to systemd; outside of systemd all of it is silently nothing.
#pragma once

#include <string>
#include <vector>

#include "daemon/snapshot.h"

namespace granary {

/// sd_notify(3), e.g. "READY=1". Trouble with the socket is logged, never thrown. Main thread only.
void NotifySystemd(const std::string& state);

/// The lines before a reload; READY=1 ends it.
[[nodiscard]] std::string ReloadingState();

/// One line on all bins for `systemctl status`: what is held or failing first, else figures.
[[nodiscard]] std::string StatusText(const std::vector<BinSnapshot>& snapshots);

/// What is sent each second: the status always, the watchdog's food only while every worker makes progress.
[[nodiscard]] std::string TickState(bool progress, const std::vector<BinSnapshot>& snapshots);

}  // namespace granary
