#include "daemon/modbus/server_eviction.h"

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace granary {
namespace {

using namespace std::chrono_literals;

const SteadyTime kNow{1000s};

/// @param first_asked, last_active how long ago
Tenant From(const std::string& host, std::optional<std::chrono::milliseconds> first_asked,
            std::chrono::milliseconds last_active) {
  Tenant tenant{.host = ParseNetwork(host).value(), .first_asked = std::nullopt, .last_active = kNow - last_active};
  if (first_asked) tenant.first_asked = kNow - *first_asked;
  return tenant;
}

std::size_t Evicted(const std::vector<Tenant>& tenants) { return ChooseEvicted(tenants, kNow); }

TEST(ChooseEvicted, OneThatNeverAskedGoesFirst) {
  EXPECT_EQ(Evicted({From("10.0.0.1", 500ms, 400ms), From("10.0.0.1", std::nullopt, 1ms)}), 1U);
}

TEST(ChooseEvicted, LongestSilentGoesFirst) {
  EXPECT_EQ(Evicted({From("10.0.0.1", 300ms, 10ms), From("10.0.0.2", 400ms, 200ms), From("10.0.0.3", 500ms, 50ms)}),
            1U);
}

TEST(ChooseEvicted, LongestSilentOfPollingClientsGoesFirst) {
  EXPECT_EQ(Evicted({From("10.0.0.1", 90s, 1s), From("10.0.0.2", 90s, 2s), From("10.0.0.3", 90s, 50ms)}), 1U);
}

TEST(ChooseEvicted, PollingClientOutlastsThoseThatAskedJustNow) {
  EXPECT_EQ(Evicted({From("10.0.0.1", 60s, 100ms), From("10.0.0.1", 5ms, 5ms), From("10.0.0.1", 1ms, 1ms)}), 1U);
}

TEST(ChooseEvicted, ClientThatStoppedPollingIsIdle) {
  EXPECT_EQ(Evicted({From("10.0.0.1", 60s, 6s), From("10.0.0.1", 5ms, 5ms)}), 0U);
}

TEST(ChooseEvicted, FloodOfOneHostDisplacesItsOwn) {
  std::vector<Tenant> tenants{From("10.0.0.2", std::nullopt, 30s), From("10.0.0.3", 60s, 40s)};
  for (int i = 0; i < 3; ++i) tenants.push_back(From("10.0.0.1", 5ms, 5ms));
  EXPECT_EQ(Evicted(tenants), 2U);
}

}  // namespace
}  // namespace granary
