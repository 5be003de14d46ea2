// Random traffic with a fixed seed: nothing but a frame of ours with a good checksum at the end of what was heard may
// be answered, and no traffic may leave the framing deaf.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/modbus/rtu_listener.h"

namespace granary::test {
namespace {

/// Random bytes, and frames of all kinds whole, cut, damaged and joined.
class Traffic {
 public:
  explicit Traffic(unsigned seed) : random_(seed) {}

  int Below(int limit) { return std::uniform_int_distribution<int>(0, limit - 1)(random_); }
  Bytes RandomBytes(int most) {
    Bytes bytes(static_cast<std::size_t>(Below(most + 1)));
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(Below(256));
    return bytes;
  }
  Bytes Frame() {
    const int addresses[] = {0, kUs, kUs, kNeighbour, 247, 255};
    const int address = addresses[Below(6)];
    switch (Below(6)) {
      case 0:
        return ReadRequest(address, Below(4000), 1 + Below(125));
      case 1:
        return ReadReply(address, RandomBytes(250));
      case 2:
        return WriteRequest(address, Below(4));
      case 3:
        return ReadReply(kNeighbour, ReadRequest(kUs));
      default: {
        Bytes pdu = RandomBytes(30);
        pdu.push_back(static_cast<std::uint8_t>(Below(256)));
        return RtuFrame(static_cast<std::uint8_t>(address), pdu);
      }
    }
  }
  Bytes Run() {
    Bytes run;
    for (int parts = 1 + Below(4); parts > 0; --parts) {
      Bytes part = Below(2) == 0 ? RandomBytes(20) : Frame();
      if (!part.empty() && Below(3) == 0) part[static_cast<std::size_t>(Below(static_cast<int>(part.size())))] ^= 0x21;
      if (Below(4) == 0) part.resize(static_cast<std::size_t>(Below(static_cast<int>(part.size()) + 1)));
      run.insert(run.end(), part.begin(), part.end());
    }
    return run;
  }

 private:
  std::mt19937 random_;
};

/// Whether `frame` lies in `run`, and so near its end that no other frame follows.
bool Ends(const Bytes& run, const Bytes& frame) {
  for (std::size_t after = 0; after < kMinRtuBytes && after + frame.size() <= run.size(); ++after) {
    if (std::equal(frame.begin(), frame.end(), run.end() - static_cast<std::ptrdiff_t>(frame.size() + after)))
      return true;
  }
  return false;
}

TEST(RtuFramingFuzz, RandomBytesAreNotAnswered) {
  Traffic traffic(20261122);
  Listener line(115200);
  for (int i = 0; i < 100'000; ++i) {
    const Bytes run = traffic.RandomBytes(40);
    if (!run.empty()) line.Hear(run);
    line.Wait(kLong);
    for (const Bytes& found : line.Take()) ASSERT_TRUE(Ends(run, found)) << testing::PrintToString(run);
  }
}

TEST(RtuFramingFuzz, OnlyAGoodFrameAtTheEndIsAnswered) {
  Traffic traffic(17);
  Listener line(115200);
  int answered = 0;
  const auto check = [&](const Bytes& heard) {
    for (const Bytes& found : line.Take()) {
      ++answered;
      ASSERT_TRUE(found[0] == 0 || found[0] == kUs);
      ASSERT_TRUE(found[0] == 0 || Ends(heard, found)) << testing::PrintToString(heard);
    }
  };
  for (int i = 0; i < 100'000 && !testing::Test::HasFatalFailure(); ++i) {
    const Bytes run = traffic.Run();
    std::size_t heard = 0;
    while (heard < run.size()) {
      const std::size_t end = std::min(run.size(), heard + 1 + static_cast<std::size_t>(traffic.Below(300)));
      line.Hear(Part(run, heard, end));
      check(Part(run, 0, heard));  // the piece itself has not been silent long enough yet
      heard = end;
      line.Wait(std::chrono::microseconds{traffic.Below(3000)});
      check(Part(run, 0, heard));
    }
    line.Wait(kLong);
    check(run);
    if (i % 100 == 0) {
      line.Hear(ReadRequest(kUs)).Pause();
      ASSERT_THAT(line.Take(), testing::ElementsAre(ReadRequest(kUs))) << testing::PrintToString(run);
    }
  }
  EXPECT_GT(answered, 1000);  // else the traffic would prove nothing
}

}  // namespace
}  // namespace granary::test
