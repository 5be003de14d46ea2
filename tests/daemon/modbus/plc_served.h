// A client that pushes two bins to a fake PLC, with all that it borrows.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/modbus/plc_client.h"
#include "tests/daemon/modbus/plc_fake.h"
#include "tests/daemon/modbus/recording_control.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary::test {

/// Waits until `met`, at most twenty seconds, a guard against hanging.
inline bool Eventually(const std::function<bool()>& met) {
  for (int i = 0; i < 20000 && !met(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds{1});
  return met();
}

/// Bins 3 and 5 in blocks of `sequence`, `volume` and `status` at registers 100 and 110; a heartbeat that no test
/// lives to see, quick retries.
class PlcClientTest : public ::testing::Test {
 protected:
  PlcClientTest() {
    options_.base = 100;
    options_.stride = 10;
    options_.fields = {"sequence", "volume", "status"};
    options_.heartbeat = std::chrono::hours{1};
    options_.timeout = std::chrono::seconds{60};
    limits_.first_retry = limits_.longest_retry = limits_.status_gap = std::chrono::milliseconds{10};
  }

  void Start(std::uint16_t port) {
    options_.address = "127.0.0.1:" + std::to_string(port);
    client_ = std::make_unique<PlcClient>(
        options_, std::vector<Bin>{Snapshot(3, 0).bin, Snapshot(5, 0).bin}, kIdentity, control_, tally_,
        [] { return kMeasuredAt + std::chrono::seconds{90}; }, limits_, 1);
  }

  /// A bin that measured for the n-th time, n minutes after kMeasuredAt.
  static BinSnapshot Snapshot(int bin, std::uint64_t n) {
    BinSnapshot snapshot = GoodSnapshot();
    snapshot.bin.id = bin;
    snapshot.good->bin = bin;
    snapshot.good->sequence = n;
    snapshot.good->utc = kMeasuredAt + std::chrono::minutes{n};
    snapshot.last = snapshot.good;
    snapshot.book.writable = true;
    return snapshot;
  }

  ModbusPlcOptions options_;
  PlcLimits limits_;
  RecordingControl control_;
  ModbusTally tally_;
  std::unique_ptr<PlcClient> client_;
};

}  // namespace granary::test
