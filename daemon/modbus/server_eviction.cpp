// Places are shared out by host first: whoever floods the server from one address displaces his own connections.
#include "daemon/modbus/server_eviction.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <tuple>
#include <vector>

namespace granary {
namespace {

enum class Standing : int { kNeverAsked, kAsked, kPolling };

Standing StandingOf(const Tenant& tenant, SteadyTime now) {
  using namespace std::chrono_literals;
  if (!tenant.first_asked) return Standing::kNeverAsked;
  const bool regular = tenant.last_active - *tenant.first_asked >= 1s;
  return regular && now - tenant.last_active < 5s ? Standing::kPolling : Standing::kAsked;
}

}  // namespace

std::size_t ChooseEvicted(std::span<const Tenant> tenants, SteadyTime now) {
  std::map<Network, int> connections;
  for (const auto& tenant : tenants) ++connections[tenant.host];
  const auto rank = [&](const Tenant& tenant) {
    return std::tuple(-connections[tenant.host], StandingOf(tenant, now), tenant.last_active);
  };
  const auto first = std::min_element(tenants.begin(), tenants.end(),
                                      [&](const Tenant& a, const Tenant& b) { return rank(a) < rank(b); });
  return static_cast<std::size_t>(first - tenants.begin());
}

}  // namespace granary
