// The configuration of the interface contract, complete, and what tests do with it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "config/config.h"

namespace granary::testing {

inline const std::string kSample = R"toml([site]
name = "depot-7"

[log]
level = "warn"

[modbus.tcp]                      # SCADA polls here
listen = "0.0.0.0:502"            # default 127.0.0.1:1502
allow = ["192.168.7.0/24"]        # who may connect; default: loopback only
write_allow = []                  # who may write registers; default: nobody
[modbus.rtu]                      # optional second server
device = "/dev/ttyS1"
baud = 19200
parity = "even"
[modbus.plc]                      # optional: push to the depot PLC (client, FC16)
address = "192.168.7.20:502"
unit = 1
base = 0                          # holding register of the PLC where the summary block is written

[[bin]]
id = 1                            # also the Modbus unit id
name = "bay-1"
footprint_m = [[0,0],[0.52,0],[0.52,0.355],[0,0.355]]   # polygon on the floor, world xy
height_m = 0.285                  # top of the bin above z = 0; also the pass-through's upper end
exclude_m = []                    # polygons on the floor that hold no grain (pillars, ducts)
schedule = { every = "30min" }    # or { at = ["06:00","18:00"], timezone = "Asia/Shanghai" }
[bin.inventory]
book_mass_kg = 15200.0
density_kg_m3 = 790.0
correction = 1.0
loss_kg = 0.0
alarm_percent = 3.0
[[bin.rig]]                       # several rigs may watch one bin; their clouds are fused
name = "a"
calibration = "stereo.yml"
pose = "world.yml"
max_skew_us = 500
left  = { driver = "aravis", id = "Vendor-Serial", exposure_us = 8000, gain_db = 0 }
right = { driver = "v4l2", id = "/dev/v4l/by-path/…" }       # aravis | v4l2 | replay | sim
projector = { driver = "gpio", chip = "/dev/gpiochip0", line = 17, settle_us = 200, max_on_ms = 50 }  # gpio | sim | none
)toml";

/// kSample with the first `from` replaced by `to`.
inline std::string Changed(const std::string& from, const std::string& to, std::string text = kSample) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

/// The line of the first `part` in `text`, 1-based.
inline int LineOf(const std::string& part, const std::string& text) {
  const auto at = text.find(part);
  EXPECT_NE(at, std::string::npos) << part;
  return 1 + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
}

/// The faults of `text`; empty when it parses.
inline std::vector<ConfigFault> FaultsOf(const std::string& text) {
  try {
    static_cast<void>(ParseConfig(text, "bay.toml"));
    return {};
  } catch (const ConfigError& error) {
    return error.faults();
  }
}

inline std::string Texts(const std::vector<ConfigFault>& faults) {
  std::string out;
  for (const auto& fault : faults) out += fault.Text() + "\n";
  return out;
}

}  // namespace granary::testing
