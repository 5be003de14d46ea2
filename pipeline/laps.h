// Times the stages of a run with the caller's stopwatch.
#pragma once

#include "pipeline/pipeline.h"

namespace granary {

/// Without a stopwatch every lap is 0. Borrows the stopwatch for its own life.
class Laps {
 public:
  explicit Laps(const Stopwatch& stopwatch) : stopwatch_(stopwatch), start_(Now()), last_(start_) {}
  /// Milliseconds since the last lap.
  double Lap() {
    const double now = Now(), lap = now - last_;
    last_ = now;
    return lap;
  }
  /// Milliseconds since construction.
  [[nodiscard]] double Total() const { return Now() - start_; }

 private:
  [[nodiscard]] double Now() const { return stopwatch_ ? stopwatch_() : 0; }
  const Stopwatch& stopwatch_;
  double start_, last_;
};

}  // namespace granary
