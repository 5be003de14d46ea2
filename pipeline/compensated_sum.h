// Sums of millions of small terms that lose no digits.
#pragma once

#include <cmath>

namespace granary {

/// Neumaier's compensated summation. The result depends on the order of the terms only in the last digits.
class CompensatedSum {
 public:
  void Add(double value) {
    const double sum = sum_ + value;
    lost_ += std::abs(sum_) >= std::abs(value) ? (sum_ - sum) + value : (value - sum) + sum_;
    sum_ = sum;
  }
  [[nodiscard]] double Value() const { return sum_ + lost_; }

 private:
  double sum_ = 0, lost_ = 0;
};

}  // namespace granary
