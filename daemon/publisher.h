// Where snapshots go.
#pragma once

#include <string_view>

#include "daemon/snapshot.h"

namespace granary {

/// Publish is called from any worker's thread and must return at once: it takes the value, it does no I/O.
class Publisher {
 public:
  virtual ~Publisher() = default;
  [[nodiscard]] virtual std::string_view Name() const = 0;
  virtual void Publish(const BinSnapshot& snapshot) = 0;
};

}  // namespace granary
