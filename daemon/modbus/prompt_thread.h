// Threads that answer in time while the pipeline keeps every core busy.
#pragma once

namespace granary {

/// Names the calling thread and gives it real-time priority, below that of the projector's guard. Where that is not
/// permitted (LimitRTPRIO=) it says so once and leaves the thread as it is; so it does, in silence, on a machine of one
/// core, where a flood of requests would leave nothing for measuring.
/// @param name at most 15 characters
void BePrompt(const char* name);

}  // namespace granary
