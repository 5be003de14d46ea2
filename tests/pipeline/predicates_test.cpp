#include "pipeline/predicates.h"

#include <cmath>
#include <cstdint>
#include <random>

#include <gtest/gtest.h>

namespace granary {
namespace {

using Wide = __int128;
using Point = Eigen::Vector2d;

int Sign(Wide value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }
int Sign(double value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }

/// Coordinates scale · (offset + k), exactly representable, with |k| < 2^12 so that many determinants are 0 or tiny.
struct LatticePoint {
  std::int64_t x, y;
  [[nodiscard]] Point At(double offset, double scale) const {
    return {scale * (offset + static_cast<double>(x)), scale * (offset + static_cast<double>(y))};
  }
};

int TrueOrientation(LatticePoint a, LatticePoint b, LatticePoint c) {
  return Sign(Wide(a.x - c.x) * (b.y - c.y) - Wide(a.y - c.y) * (b.x - c.x));
}

int TrueInCircle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const auto lift = [&](LatticePoint p) { return Wide(p.x - d.x) * (p.x - d.x) + Wide(p.y - d.y) * (p.y - d.y); };
  const auto minor = [&](LatticePoint p, LatticePoint q) {
    return Wide(p.x - d.x) * (q.y - d.y) - Wide(q.x - d.x) * (p.y - d.y);
  };
  return Sign(minor(b, c) * lift(a) + minor(c, a) * lift(b) + minor(a, b) * lift(c));
}

class Lattice {
 public:
  explicit Lattice(int span) : coordinate_(-span, span) {}
  LatticePoint operator()() { return {coordinate_(random_), coordinate_(random_)}; }

 private:
  std::mt19937 random_{7};
  std::uniform_int_distribution<int> coordinate_;
};

TEST(Orientation, AgreesWithIntegersWhereDoublesLoseTheDigits) {
  // 2^52 + k uses all 53 bits: the products need more than twice as many.
  Lattice random(4);
  for (int i = 0; i < 20000; ++i) {
    const LatticePoint a = random(), b = random(), c = random();
    const auto at = [](LatticePoint p) { return p.At(0x1p52, 0x1p-52); };
    ASSERT_EQ(Sign(Orientation(at(a), at(b), at(c))), TrueOrientation(a, b, c));
    ASSERT_EQ(Sign(ExactOrientation(at(a), at(b), at(c))), TrueOrientation(a, b, c));
  }
}

TEST(Orientation, SeesOneUnitInTheLastPlaceOfALongThinTriangle) {
  const Eigen::Vector2d b(12, 12), c(24, 24);
  EXPECT_EQ(Orientation({0.5, 0.5}, b, c), 0);
  EXPECT_GT(Orientation({0.5, std::nextafter(0.5, 1)}, b, c), 0);
  EXPECT_LT(Orientation({0.5, std::nextafter(0.5, 0)}, b, c), 0);
}

TEST(InCircle, AgreesWithIntegersOnCrowdedLattices) {
  Lattice random(6);
  for (const double scale : {1.0, 0.001, 0x1p-40}) {
    for (int i = 0; i < 20000; ++i) {
      const LatticePoint a = random(), b = random(), c = random(), d = random();
      if (scale == 0.001) {
        // not representable: only the agreement of filter and exact sign can be asked for
        const auto at = [](LatticePoint p) { return p.At(1000, 0.001); };
        ASSERT_EQ(Sign(InCircle(at(a), at(b), at(c), at(d))), Sign(ExactInCircle(at(a), at(b), at(c), at(d))));
        continue;
      }
      const auto at = [scale](LatticePoint p) { return p.At(0, scale); };
      ASSERT_EQ(Sign(InCircle(at(a), at(b), at(c), at(d))), TrueInCircle(a, b, c, d));
      ASSERT_EQ(Sign(ExactInCircle(at(a), at(b), at(c), at(d))), TrueInCircle(a, b, c, d));
    }
  }
}

TEST(InCircle, AgreesWithIntegersWhereDoublesLoseTheDigits) {
  Lattice random(1 << 28);  // differences below 2^30: the determinant stays below 2^124
  for (int i = 0; i < 20000; ++i) {
    const LatticePoint a = random(), b = random(), c = random();
    // The fourth corner of a rectangle lies on the circle; moved by one step it is just inside or outside.
    for (const int step : {-1, 0, 1}) {
      const LatticePoint p{a.x, a.y}, q{b.x, a.y}, r{b.x, b.y}, s{a.x + step, b.y};
      const auto at = [](LatticePoint l) { return l.At(0x1p51, 0x1p-30); };
      ASSERT_EQ(Sign(InCircle(at(p), at(q), at(r), at(s))), TrueInCircle(p, q, r, s));
      ASSERT_EQ(Sign(InCircle(at(p), at(c), at(r), at(s))), TrueInCircle(p, c, r, s));
    }
  }
}

TEST(ExactInCircle, HandlesDifferencesThatDoNotFitADouble) {
  // 1e20 and 1e-20: a − d needs two doubles. Unit circle scaled by 1e20, d a hair inside or outside.
  const Point a(1e20, 0), b(0, 1e20), c(-1e20, 0);
  EXPECT_GT(ExactInCircle(a, b, c, Point(1e-20, -1e20 + 16384)), 0);
  EXPECT_LT(ExactInCircle(a, b, c, Point(1e-20, -1e20)), 0);
  EXPECT_EQ(ExactInCircle(a, b, c, Point(0, -1e20)), 0);
}

}  // namespace
}  // namespace granary
