// What may be asked over the local socket, as JSON.
//
// {"command":"inject","bin":1,"seconds":60,"volume_m3":12.3,"error_rate_percent":-3.5,"level_mean_m":1.2,
//  "temperature_c":21,"reason":"frame_missing"}   all but seconds optional (daemon/injection.h); seconds 0 ends it
// {"command":"measure","bin":1}, and so "acknowledge", "inhibit", "release": as register 910 does
// {"command":"status","bin":1}
// "bin" may be left out where there is one alone.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "daemon/bin_monitor.h"

namespace granary {

/// Does what `request` asks of one of `bins` and returns at once. Any thread.
/// @param who names the client for log and journal
/// @return {"ok":true,…} with the bin's state after it (the keys of "status"), or {"error":"…"} that says what is wrong
///   and what is allowed
[[nodiscard]] nlohmann::json AnswerLocal(const nlohmann::json& request, const std::string& who,
                                         const std::vector<BinMonitor*>& bins);

}  // namespace granary
