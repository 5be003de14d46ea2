// A number too long for one double is kept as a sum of doubles that do not overlap (an expansion, Shewchuk 1997);
// sums and products of expansions are exact, and zeros are dropped on the way, so that short inputs stay short.
#include "pipeline/predicates.h"

#include <array>
#include <cmath>

namespace granary {
namespace {

/// An exact number: the sum of `size` terms of growing magnitude, none zero.
template <int N>
struct Expansion {
  std::array<double, N> term;  // left uninitialised on purpose: only the first `size` are ever read
  int size = 0;

  void Append(double value) {
    if (value != 0) term[size++] = value;
  }
  [[nodiscard]] double Sign() const { return size == 0 ? 0.0 : term[size - 1]; }
};

/// high + low == a + b exactly.
void TwoSum(double a, double b, double& high, double& low) {
  high = a + b;
  const double b_virtual = high - a;
  const double a_virtual = high - b_virtual;
  low = (a - a_virtual) + (b - b_virtual);
}

/// high + low == a · b exactly.
void TwoProduct(double a, double b, double& high, double& low) {
  high = a * b;
  low = std::fma(a, b, -high);
}

Expansion<2> Difference(double a, double b) {
  Expansion<2> result;
  double high, low;
  TwoSum(a, -b, high, low);
  result.Append(low);
  result.Append(high);
  return result;
}

/// Merges the terms by magnitude and carries the rounding error of each addition along.
template <int N, int M>
Expansion<N + M> Sum(const Expansion<N>& a, const Expansion<M>& b, double sign_of_b = 1.0) {
  Expansion<N + M> result;
  int i = 0, j = 0;
  const auto next = [&] {
    const bool from_a = j == b.size || (i < a.size && std::abs(a.term[i]) < std::abs(b.term[j]));
    return from_a ? a.term[i++] : sign_of_b * b.term[j++];
  };
  const int count = a.size + b.size;
  if (count == 0) return result;
  double carry = next();
  for (int k = 1; k < count; ++k) {
    double low;
    TwoSum(carry, next(), carry, low);
    result.Append(low);
  }
  result.Append(carry);
  return result;
}

template <int N>
Expansion<2 * N> Scale(const Expansion<N>& a, double factor) {
  Expansion<2 * N> result;
  if (a.size == 0) return result;
  double carry, low;
  TwoProduct(a.term[0], factor, carry, low);
  result.Append(low);
  for (int i = 1; i < a.size; ++i) {
    double high, product_low, sum;
    TwoProduct(a.term[i], factor, high, product_low);
    TwoSum(carry, product_low, sum, low);
    result.Append(low);
    TwoSum(high, sum, carry, low);
    result.Append(low);
  }
  result.Append(carry);
  return result;
}

template <int N, int M>
Expansion<2 * N * M> Product(const Expansion<N>& a, const Expansion<M>& b) {
  Expansion<2 * N * M> total;
  for (int j = 0; j < b.size; ++j) {
    const auto partial = Scale(a, b.term[j]);
    const auto sum = Sum(total, partial);
    total.size = sum.size;
    for (int k = 0; k < sum.size; ++k) total.term[k] = sum.term[k];
  }
  return total;
}

}  // namespace

double ExactOrientation(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const auto ax = Difference(a.x(), c.x()), ay = Difference(a.y(), c.y());
  const auto bx = Difference(b.x(), c.x()), by = Difference(b.y(), c.y());
  return Sum(Product(ax, by), Product(ay, bx), -1.0).Sign();
}

double ExactInCircle(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
                     const Eigen::Vector2d& d) {
  const auto ax = Difference(a.x(), d.x()), ay = Difference(a.y(), d.y());
  const auto bx = Difference(b.x(), d.x()), by = Difference(b.y(), d.y());
  const auto cx = Difference(c.x(), d.x()), cy = Difference(c.y(), d.y());
  const auto lift = [](const auto& x, const auto& y) { return Sum(Product(x, x), Product(y, y)); };
  const auto minor = [](const auto& px, const auto& py, const auto& qx, const auto& qy) {
    return Sum(Product(px, qy), Product(qx, py), -1.0);
  };
  const auto a_part = Product(minor(bx, by, cx, cy), lift(ax, ay));
  const auto b_part = Product(minor(cx, cy, ax, ay), lift(bx, by));
  const auto c_part = Product(minor(ax, ay, bx, by), lift(cx, cy));
  return Sum(Sum(a_part, b_part), c_part).Sign();
}

}  // namespace granary
