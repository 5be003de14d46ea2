// Deadlines are by state, not by schedule: once a day is no hang, half a minute of silence from an idle worker is one.
#include "daemon/progress.h"

namespace granary {

std::chrono::milliseconds DeadlineOf(CycleState state, const CycleOptions& options, std::size_t pairs) {
  using std::chrono::seconds;
  const auto count = static_cast<int>(pairs < 1 ? 1 : pairs);
  switch (state) {
    case CycleState::kCapturing:
      return count * seconds{60};  // opening a network camera and its retries take several seconds each
    case CycleState::kMeasuring:
      return count * seconds{300};  // a second or two on the target; minutes on an emulated processor
    case CycleState::kRetrying:
      return options.retry_delay + seconds{10};
    case CycleState::kIdle:
    case CycleState::kGating:
    case CycleState::kPublishing:
      break;
  }
  return seconds{30};  // a disk that is slow to sync, a device that is slow to be reopened
}

}  // namespace granary
