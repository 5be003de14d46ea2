// What all Modbus servers and the PLC client of one process count together.
#pragma once

#include <atomic>
#include <cstdint>

namespace granary {

/// One moment of the counters below; they wrap round, as a u32 does. Registers 240–299.
struct ModbusCounters {
  std::uint32_t clients = 0;         ///< TCP and TLS clients connected now
  std::uint32_t requests = 0;        ///< complete requests answered
  std::uint32_t malformed = 0;       ///< connections closed for what they sent
  std::uint32_t refused = 0;         ///< connections from addresses that are not allowed, or without a good certificate
  std::uint32_t evicted = 0;         ///< connections closed to make room for a new one
  std::uint32_t timed_out = 0;       ///< connections closed as idle, stalled, or for an unfinished frame
  std::uint32_t writes = 0;          ///< requests that wrote
  std::uint32_t writes_refused = 0;  ///< writes from where nobody may write
  std::uint32_t rtu_requests = 0;    ///< frames on the serial line for us, answered
  std::uint32_t rtu_others = 0;      ///< good frames on the serial line that are not for us
  std::uint32_t rtu_errors = 0;      ///< noise, half frames and wrong checksums on the serial line
  std::uint32_t plc_connected = 0;   ///< 1 while the PLC is connected
  std::uint32_t plc_pushes = 0;      ///< blocks that the PLC has taken
  std::uint32_t plc_failures = 0;    ///< connections and writes that failed, read-backs that differed
  std::uint32_t plc_pushed_at = 0;   ///< UTC seconds of the newest block taken; 0 none
};

/// The counters themselves. Any thread.
struct ModbusTally {
  using Count = std::atomic<std::uint32_t>;
  Count clients = 0, requests = 0, malformed = 0, refused = 0, evicted = 0, timed_out = 0;
  Count writes = 0, writes_refused = 0;
  Count rtu_requests = 0, rtu_others = 0, rtu_errors = 0;
  Count plc_connected = 0, plc_pushes = 0, plc_failures = 0, plc_pushed_at = 0;

  [[nodiscard]] ModbusCounters Read() const {
    return {.clients = clients,
            .requests = requests,
            .malformed = malformed,
            .refused = refused,
            .evicted = evicted,
            .timed_out = timed_out,
            .writes = writes,
            .writes_refused = writes_refused,
            .rtu_requests = rtu_requests,
            .rtu_others = rtu_others,
            .rtu_errors = rtu_errors,
            .plc_connected = plc_connected,
            .plc_pushes = plc_pushes,
            .plc_failures = plc_failures,
            .plc_pushed_at = plc_pushed_at};
  }
};

}  // namespace granary
