// The kernel lets a busy thread of normal priority finish its slice before one that has just got work: with all cores
// busy an answer waits up to 20 ms, and 1 ms with real-time priority. The kernel's own limit (sched_rt_runtime_us)
// keeps a flood from taking a whole core.
#include "daemon/modbus/prompt_thread.h"

#include <atomic>
#include <system_error>
#include <thread>

#include <pthread.h>
#include <sched.h>
#include <spdlog/spdlog.h>

namespace granary {

void BePrompt(const char* name) {
  static std::atomic<bool> told{false};
  static_cast<void>(pthread_setname_np(pthread_self(), name));
  if (std::thread::hardware_concurrency() < 2) return;
  const sched_param lowest{.sched_priority = 1};
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &lowest);
  if (error == 0 || told.exchange(true)) return;
  spdlog::info("modbus: no real-time priority, answers may wait for the pipeline: {}",
               std::generic_category().message(error));
}

}  // namespace granary
