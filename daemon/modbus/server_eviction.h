// Who has to go when a newcomer finds the server full.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "daemon/modbus/connection.h"
#include "daemon/modbus/socket.h"

namespace granary {

/// What the choice rests on.
struct Tenant {
  Network host;                           ///< from HostOf
  std::optional<SteadyTime> first_asked;  ///< first complete request; empty when there was none
  SteadyTime last_active;                 ///< newest complete request, or the connect
};

/// Of the host with the most connections: one that never asked anything goes first, then the one that has been silent
/// longest. A client that has kept asking for a second or more, and did within the last five, goes after all that have
/// not, so that a flood of clients that ask once cannot push a polling one out.
/// @param tenants at least one
/// @return its index
[[nodiscard]] std::size_t ChooseEvicted(std::span<const Tenant> tenants, SteadyTime now);

}  // namespace granary
