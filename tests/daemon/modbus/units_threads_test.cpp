// Readers hammer while a publisher publishes: every block that is read must be one measurement in one format.
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/modbus/units.h"
#include "tests/daemon/modbus/units_fixture.h"

namespace granary {
namespace {

using test::Words;

constexpr int kReads = 3000, kChanges = 200;       // of each reader, at least
constexpr auto kGuard = std::chrono::seconds{60};  // against hanging; no run waits for it
constexpr std::uint32_t kNaN = 0x7FC00000;         // the one quiet NaN that is written out
constexpr int kNumbers = 60000;                    // below 65536, so that the sequence tells them apart
constexpr int kSummary = 0, kSummaryWords = 125;   // registers 10–50, 62 and parts of 100–124 are figures
constexpr int kIntegers = 3000, kIntegerWords = 44;
constexpr std::array kMirrors{2000, 2200, 2400, 2600};  // in the order of ByteOrder's numbers

/// A measurement of which every figure is `i` as the registers show it. Every third has another byte order than its
/// neighbours, every fifth is held under a policy that hides it.
BinSnapshot Numbered(int i) {
  auto snapshot = test::GoodSnapshot();
  Measurement& m = *snapshot.good;
  m.sequence = static_cast<std::uint64_t>(i);
  for (auto* figure : {&m.volume_m3, &m.volume_percent, &m.level_mean_m, &m.level_min_m, &m.level_max_m,
                       &m.distance_mean_m, &m.distance_min_m, &m.distance_max_m, &m.free_volume_m3, &m.density_kg_m3,
                       &m.error_rate_percent, &m.error_rate_u95_percent, &m.coverage_percent, &m.volume_interpolated_m3,
                       &m.repeatability_rsd_percent, &m.epipolar_rms_px, &m.temperature_c, &m.volume_u95_m3}) {
    *figure = i;
  }
  m.mass_kg = m.loss_kg = m.book_mass_kg = 1000.0 * i;  // kg, shown in tonnes
  snapshot.rate_m3_h = i;
  snapshot.configuration_hash = static_cast<std::uint32_t>(i);
  snapshot.format.byte_order = static_cast<ByteOrder>(i / 3 % 4);
  if (i % 5 == 0) {
    snapshot.held = true;
    snapshot.format.invalid = InvalidPolicy::kNan;
  }
  return snapshot;
}

std::uint32_t FigureOf(int i) { return i % 5 == 0 ? kNaN : std::bit_cast<std::uint32_t>(static_cast<float>(i)); }

/// The 32 bits of two words that are in `order`.
std::uint32_t Decode(const std::uint16_t* words, ByteOrder order) {
  const auto swapped = [](std::uint16_t word) { return static_cast<std::uint16_t>((word << 8) | (word >> 8)); };
  std::uint16_t high = words[0], low = words[1];
  if (order == ByteOrder::kCdab || order == ByteOrder::kDcba) std::swap(high, low);
  if (order == ByteOrder::kDcba || order == ByteOrder::kBadc) {
    high = swapped(high);
    low = swapped(low);
  }
  return (std::uint32_t{high} << 16) | low;
}

/// What is wrong with registers 0–124 in that order; empty when they are measurement `i` throughout.
std::string FaultOf(const Words& words, int i, ByteOrder order) {
  if (words[5] != i || words[64] != i) return "the sequences differ";
  for (int address = 10; address <= 62; address += 2) {
    if (address >= 52 && address < 62) continue;
    if (Decode(&words[address], order) != FigureOf(i)) return "figure at " + std::to_string(address);
  }
  for (const int address : {100, 102, 104, 112, 116}) {
    if (Decode(&words[address], order) != FigureOf(i)) return "figure at " + std::to_string(address);
  }
  if (Decode(&words[58], order) != static_cast<std::uint32_t>(i)) return "hash";
  if (((words[0] & 1) == 0) != (i % 5 == 0)) return "status";
  return {};
}

class Hammered {
 public:
  Hammered() {
    units_.Publish(Numbered(1));
    publisher_ = std::jthread([this](const std::stop_token& stop) {
      for (int i = 2; !stop.stop_requested(); i = i % kNumbers + 1) {
        units_.Publish(Numbered(i));
        std::this_thread::yield();  // a mutex knows no queue: who never pauses keeps it
      }
    });
  }

  /// Reads one block from three threads. `check` says which measurement the words are of, or throws what is wrong.
  void Read(int address, int count, const std::function<int(const Words&)>& check) {
    std::vector<std::jthread> readers;
    std::atomic<bool> failed = false;
    for (int reader = 0; reader < 3; ++reader) {
      readers.emplace_back([&, this] {
        const auto give_up = std::chrono::steady_clock::now() + kGuard;
        int before = 0, changes = 0;
        for (int reads = 0; (reads < kReads || changes < kChanges) && !failed; ++reads) {
          const Pdu reply = units_.Answer(3, test::ReadPdu(address, count), {"reader", false});
          Words words;
          for (std::size_t at = 2; at + 1 < reply.size(); at += 2) words.push_back(WordAt(reply, at));
          try {
            const int found = check(words);
            changes += found != before;
            before = found;
          } catch (const std::exception& error) {
            failed = true;
            ADD_FAILURE() << "block at " << address << ": " << error.what();
          }
          std::this_thread::yield();
          if (std::chrono::steady_clock::now() > give_up) {
            failed = true;
            ADD_FAILURE() << "the publisher never ran beside the readers: the test shows nothing";
          }
        }
      });
    }
  }

 private:
  test::RecordingControl control_;
  ModbusTally tally_;
  ModbusUnits units_{test::kIdentity, {test::GoodSnapshot().bin}, control_, tally_};
  std::jthread publisher_;
};

TEST(HammeredUnits, SummaryIsOneMeasurementInOneFormat) {
  Hammered().Read(kSummary, kSummaryWords, [](const Words& words) {
    const int i = words.at(5);
    const std::string fault = FaultOf(words, i, static_cast<ByteOrder>(i / 3 % 4));
    if (!fault.empty()) throw std::runtime_error(std::to_string(i) + ": " + fault);
    return i;
  });
}

TEST(HammeredUnits, MirrorsAreOneMeasurementInTheirOwnOrder) {
  for (std::size_t order = 0; order < kMirrors.size(); ++order) {
    Hammered().Read(kMirrors.at(order), kSummaryWords, [order](const Words& words) {
      const int i = words.at(5);
      const std::string fault = FaultOf(words, i, static_cast<ByteOrder>(order));
      if (!fault.empty()) throw std::runtime_error(std::to_string(i) + ": " + fault);
      return i;
    });
  }
}

TEST(HammeredUnits, IntegersAreOneMeasurement) {
  Hammered().Read(kIntegers, kIntegerWords, [](const Words& words) {
    const auto first = std::bit_cast<std::int32_t>(test::U32At(words.data()));
    for (int at = 0; at < kIntegerWords; at += 2) {
      if (std::bit_cast<std::int32_t>(test::U32At(words.data() + at)) != first) {
        throw std::runtime_error("integer at " + std::to_string(kIntegers + at));
      }
    }
    return first;
  });
}

}  // namespace
}  // namespace granary
