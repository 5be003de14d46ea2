// Ctrl-C and SIGTERM while a projector may be lit.
#pragma once

#include <mutex>

namespace granary {

/// From now on SIGINT, SIGTERM and SIGHUP end the program only while no CaptureGuard is alive, with the status that a
/// shell gives for the signal; a second signal does not wait. Called once, first thing in main, before any thread.
void EndOnlyBetweenCaptures();

/// While one lives the program is not ended by a signal: the projector may be lit. One at a time; any thread.
class CaptureGuard {
 public:
  CaptureGuard();

 private:
  std::unique_lock<std::timed_mutex> lock_;
};

}  // namespace granary
