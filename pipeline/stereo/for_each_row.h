// The one way in which the matcher shares out rows that do not depend on each other.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace granary {

/// Calls `body(y)` for the rows 0 … rows − 1, from several threads.
template <typename Body>
void ForEachRow(int rows, Body body) {
  tbb::parallel_for(tbb::blocked_range<int>(0, rows, 16), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) body(y);
  });
}

}  // namespace granary
