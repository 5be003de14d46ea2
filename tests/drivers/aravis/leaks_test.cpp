// After many cycles the process has as many descriptors and threads as before, and no more memory.
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>

#include "tests/drivers/aravis/aravis_test.h"

namespace granary {
namespace {

// Sanitizers keep freed memory for a while.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kTellsMemory = false;
#else
constexpr bool kTellsMemory = true;
#endif

struct Usage {
  long descriptors = 0, threads = 0, resident_kib = 0;
};

long CountIn(const char* folder) {
  return std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator{});
}

Usage UsageNow() {
  Usage usage{CountIn("/proc/self/fd"), CountIn("/proc/self/task"), 0};
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmRSS:", 0) == 0) usage.resident_kib = std::stol(line.substr(6));
  }
  return usage;
}

class Leaks : public AravisTest {
 protected:
  static void Cycle(const std::string& id) {
    CameraAravis camera(AravisOptions(id), TriggerMode::kSoftware, kSize);
    EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
  }
  /// @param warmup cycles until caches, and the allocator's heap, are as large as they get
  static void RunCycles(int warmup, int cycles, long grown_kib) {
    const FakeGige fake;
    for (int i = 0; i < warmup; ++i) Cycle("127.0.0.1");
    const Usage before = UsageNow();
    for (int i = 0; i < cycles; ++i) Cycle("127.0.0.1");
    const Usage after = UsageNow();
    EXPECT_EQ(after.descriptors, before.descriptors);
    EXPECT_EQ(after.threads, before.threads);
    if (kTellsMemory) {
      EXPECT_LE(after.resident_kib, before.resident_kib + grown_kib);
    }
    std::cout << cycles << " cycles: descriptors " << before.descriptors << " -> " << after.descriptors << ", threads "
              << before.threads << " -> " << after.threads << ", resident KiB " << before.resident_kib << " -> "
              << after.resident_kib << "\n";
  }
};

// The allocator's own coming and going is a few hundred KiB; a frame kept each time would be 15,000.
TEST_F(Leaks, AreNotSeenIn200Cycles) { RunCycles(50, 200, 2048); }

TEST_F(Leaks, DISABLED_AreNotSeenIn10000Cycles) { RunCycles(200, 10'000, 4096); }

TEST_F(Leaks, AreNotLeftByRefusedOpenings) {
  const FakeGige fake;
  CameraOptions refused = AravisOptions();
  refused.features = {{"NoSuchFeature", true}};
  for (int i = 0; i < 20; ++i) (void)RefusalOf(refused);
  const Usage before = UsageNow();
  for (int i = 0; i < 100; ++i) EXPECT_EQ(RefusalOf(refused).reason, Reason::kSettingRefused);
  const Usage after = UsageNow();
  EXPECT_EQ(after.descriptors, before.descriptors);
  EXPECT_EQ(after.threads, before.threads);
  if (kTellsMemory) {
    EXPECT_LE(after.resident_kib, before.resident_kib + 2048);
  }
}

}  // namespace
}  // namespace granary
