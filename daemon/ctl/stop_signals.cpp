// The default for a signal is to end at once, and a line that was high may then stay high. So the signals are blocked
// in every thread, and one thread takes them when nothing is lit.
#include "daemon/ctl/stop_signals.h"

#include <pthread.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <ctime>
#include <system_error>
#include <thread>

namespace granary {
namespace {

std::timed_mutex& Capturing() {
  static std::timed_mutex mutex;
  return mutex;
}

[[noreturn]] void EndOn(sigset_t signals) {
  int signal = 0;
  while (sigwait(&signals, &signal) != 0) {
  }
  constexpr timespec kNow{};
  while (!Capturing().try_lock_for(std::chrono::milliseconds(50)) && sigtimedwait(&signals, nullptr, &kNow) < 0) {
  }
  _exit(128 + signal);
}

}  // namespace

void EndOnlyBetweenCaptures() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals, signal);
  if (const int error = pthread_sigmask(SIG_BLOCK, &signals, nullptr); error != 0)
    throw std::system_error(error, std::generic_category(), "sigmask");
  std::thread(EndOn, signals).detach();
}

CaptureGuard::CaptureGuard() : lock_(Capturing()) {}

}  // namespace granary
