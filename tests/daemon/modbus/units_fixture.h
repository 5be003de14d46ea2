// Units of one or two bins with clocks that stand still, and requests to them.
#pragma once

#include <bit>
#include <chrono>
#include <cstdint>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/modbus/units.h"
#include "tests/daemon/modbus/recording_control.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary::test {

using Words = std::vector<std::uint16_t>;

inline Pdu ReadPdu(int address, int count, std::uint8_t function = 3) {
  return {function, static_cast<std::uint8_t>(address >> 8), static_cast<std::uint8_t>(address),
          static_cast<std::uint8_t>(count >> 8), static_cast<std::uint8_t>(count)};
}

/// FC6; FC5 has the same form.
inline Pdu WritePdu(int address, int value, std::uint8_t function = 6) { return ReadPdu(address, value, function); }

inline Pdu WriteManyPdu(int address, const Words& words) {
  Pdu request = ReadPdu(address, static_cast<int>(words.size()), 16);
  request.push_back(static_cast<std::uint8_t>(2 * words.size()));
  for (const std::uint16_t word : words) {
    request.push_back(static_cast<std::uint8_t>(word >> 8));
    request.push_back(static_cast<std::uint8_t>(word));
  }
  return request;
}

inline void AppendF32(float value, Words& words) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  words.push_back(static_cast<std::uint16_t>(bits >> 16));
  words.push_back(static_cast<std::uint16_t>(bits));
}

/// Bin 3, measured, with book data that clients may write.
class UnitsTest : public ::testing::Test {
 protected:
  UnitsTest() {
    snapshot_.book.writable = true;
    snapshot_.book.in_force =
        WithBook({}, {.book_mass_kg = 15200, .density_kg_m3 = 790, .correction = 1, .loss_kg = 12});
    units_.Publish(snapshot_);
  }

  Pdu Ask(const Pdu& request, std::string_view who = "192.168.7.20:40112", int unit = 3) {
    return units_.Answer(static_cast<std::uint8_t>(unit), request, {who, true});
  }
  Pdu AskAsReader(const Pdu& request) { return units_.Answer(3, request, {"192.168.7.99:50000", false}); }

  Words Read(int address, int count) {
    const Pdu reply = Ask(ReadPdu(address, count));
    Words words;
    for (std::size_t i = 2; i + 1 < reply.size(); i += 2) words.push_back(WordAt(reply, i));
    EXPECT_EQ(words.size(), static_cast<std::size_t>(count));
    return words;
  }
  std::uint16_t ReadOne(int address) { return Read(address, 1).at(0); }
  float ReadF32(int address) { return std::bit_cast<float>(U32At(Read(address, 2).data())); }

  UtcTime utc_ = kMeasuredAt + std::chrono::seconds{90};
  SteadyTime steady_{std::chrono::hours{1}};
  RecordingControl control_;
  ModbusTally tally_;
  BinSnapshot snapshot_ = GoodSnapshot();
  ModbusUnits units_{kIdentity, {snapshot_.bin}, control_, tally_, [this] { return utc_; }, [this] { return steady_; }};
};

}  // namespace granary::test
