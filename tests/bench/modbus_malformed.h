// Frames that no good client sends, and what must come back.
#pragma once

#include <cstdint>

#include "tests/bench/modbus_rivals.h"

namespace granary::bench {

struct MalformedCount {
  std::uint64_t frames = 0;         ///< malformed frames sent
  std::uint64_t exceptions = 0;     ///< of them, answered with the exception that the specification asks for
  std::uint64_t closed = 0;         ///< of them, broken headers and cut frames, answered with a closed connection
  std::uint64_t good = 0;           ///< mutations that were good requests after all, answered as such
  std::uint64_t wrong_replies = 0;  ///< anything else
};

/// Sends malformed frames, mutated from good ones, to our server until `frames` of them are through; connections of up
/// to 40 frames each, pipelined, that end with a broken header or a cut frame. What a reply must be is worked out from
/// the specification and the map's limits, not by our server's code.
/// @throws std::system_error when the server takes no more connections
[[nodiscard]] MalformedCount SendMalformed(const ServerProcess& server, std::uint64_t frames, std::uint32_t seed);

}  // namespace granary::bench
