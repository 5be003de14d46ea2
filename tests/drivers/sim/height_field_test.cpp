#include "drivers/sim/height_field.h"

#include <cmath>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

namespace granary {
namespace {

const Polygon kL{{0, 0}, {3, 0}, {3, 1}, {1, 1}, {1, 2}, {0, 2}};

// z = f(x, y) at the nodes.
template <typename F>
HeightField FieldOver(const Polygon& polygon, int cells, F f) {
  HeightField field = GridOver(polygon, cells);
  for (int j = 0; j < field.rows; ++j) {
    for (int i = 0; i < field.columns; ++i) {
      field.z_m[static_cast<std::size_t>(j) * field.columns + i] =
          f(field.origin_m.x() + i * field.cell_m.x(), field.origin_m.y() + j * field.cell_m.y());
    }
  }
  return field;
}

double Integral(const HeightField& field, const std::vector<double>& weights) {
  return std::inner_product(weights.begin(), weights.end(), field.z_m.begin(), 0.0);
}

// Tolerance of exact integrals: rounding of some 10⁴ sums of order 1.
constexpr double kRounding = 1e-12;

TEST(GridOver, PutsItsBorderOnTheFootprint) {
  const HeightField grid = GridOver({{0.1, 0.2}, {0.62, 0.2}, {0.62, 0.555}, {0.1, 0.555}}, 520);
  const Eigen::Vector2d end =
      grid.origin_m + grid.cell_m.cwiseProduct(Eigen::Vector2d(grid.columns - 1, grid.rows - 1));
  EXPECT_NEAR(end.x(), 0.62, kRounding);
  EXPECT_NEAR(end.y(), 0.555, kRounding);
}

TEST(GridOver, RefusesALine) { EXPECT_THROW((void)GridOver({{0, 0}, {1, 0}, {2, 0}}, 10), std::invalid_argument); }

TEST(HeightAt, IsBilinearBetweenNodes) {
  const HeightField field = FieldOver({{0, 0}, {1, 0}, {1, 1}, {0, 1}}, 1, [](double x, double y) { return x * y; });
  EXPECT_DOUBLE_EQ(HeightAt(field, {0.25, 0.5}), 0.125);
}

TEST(NodeWeights, AddUpToTheAreaOfAConcavePolygon) {
  const HeightField grid = GridOver(kL, 37);  // cells that the edges cut
  const auto weights = NodeWeights_m2(grid, kL, {});
  EXPECT_NEAR(std::accumulate(weights.begin(), weights.end(), 0.0), 4.0, kRounding);
}

TEST(NodeWeights, DoNotDependOnTheWinding) {
  const HeightField grid = GridOver(kL, 37);
  const auto forwards = NodeWeights_m2(grid, kL, {});
  const auto backwards = NodeWeights_m2(grid, Polygon(kL.rbegin(), kL.rend()), {});
  for (std::size_t k = 0; k < forwards.size(); ++k) ASSERT_NEAR(forwards[k], backwards[k], kRounding);
}

TEST(NodeWeights, IntegrateAPlaneOverATriangleExactly) {
  const Polygon triangle{{0, 0}, {2, 0.3}, {0.4, 1.7}};
  const HeightField field = FieldOver(triangle, 41, [](double x, double y) { return 1 + 2 * x + 3 * y; });
  // Area times the plane's height at the centroid (0.8, 2/3).
  EXPECT_NEAR(Integral(field, NodeWeights_m2(field, triangle, {})), Area_m2(triangle) * (1 + 1.6 + 2.0), kRounding);
}

TEST(NodeWeights, IntegrateTheBilinearSurfaceItself) {
  const Polygon triangle{{0, 0}, {2, 0.3}, {0.4, 1.7}};
  const HeightField field =
      FieldOver(triangle, 3, [](double x, double y) { return std::sin(5 * x) * std::cos(4 * y); });
  const double exact = Integral(field, NodeWeights_m2(field, triangle, {}));
  double sum = 0;
  constexpr int kSamples = 2000;
  const double dx = 2.0 / kSamples, dy = 1.7 / kSamples;
  for (int j = 0; j < kSamples; ++j) {
    for (int i = 0; i < kSamples; ++i) {
      const Eigen::Vector2d at((i + 0.5) * dx, (j + 0.5) * dy);
      if (Contains(triangle, at)) sum += HeightAt(field, at) * dx * dy;
    }
  }
  EXPECT_NEAR(
      exact, sum,
      5e-4);  // the midpoint rule's error at the border: perimeter 6 m × sample 1 mm × height, mostly cancelling
}

TEST(NodeWeights, LeaveOutExcludedPolygons) {
  const HeightField grid = GridOver(kL, 37);
  const auto weights =
      NodeWeights_m2(grid, kL, {{{0.2, 0.2}, {0.5, 0.2}, {0.5, 0.4}, {0.2, 0.4}}, {{2, 0}, {2.5, 0}, {2.5, 0.3}}});
  EXPECT_NEAR(std::accumulate(weights.begin(), weights.end(), 0.0), 4.0 - 0.06 - 0.075, kRounding);
}

TEST(NodeWeights, RefuseExcludedPolygonsThatOverlap) {
  const HeightField grid = GridOver(kL, 37);
  const Polygon a{{0.2, 0.2}, {0.6, 0.2}, {0.6, 0.6}, {0.2, 0.6}}, b{{0.4, 0.4}, {0.9, 0.4}, {0.9, 0.9}, {0.4, 0.9}};
  EXPECT_THROW((void)NodeWeights_m2(grid, kL, {a, b}), std::invalid_argument);
}

TEST(NodeWeights, RefuseAnExcludedPolygonBeyondTheFootprint) {
  const HeightField grid = GridOver(kL, 37);
  EXPECT_THROW((void)NodeWeights_m2(grid, kL, {{{0.5, 0.5}, {2, 0.5}, {2, 1.5}, {0.5, 1.5}}}), std::invalid_argument);
}

class RoughSurface : public testing::Test {
 protected:
  HeightField field_ = FieldOver({{0, 0}, {1, 0}, {1, 0.7}, {0, 0.7}}, 50, [](double x, double y) {
    return 0.3 + 0.1 * std::sin(9 * x) * std::cos(11 * y) + 0.02 * std::sin(60 * x + 40 * y);
  });
};

TEST_F(RoughSurface, IsMetWhereTheRayIsOnIt) {
  const SurfaceCaster caster(field_);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  int hits = 0;
  for (int k = 0; k < 2000; ++k) {
    const Eigen::Vector3d from(unit(random), 0.7 * unit(random), 1.0), to(unit(random), 0.7 * unit(random), 0.0);
    if (const auto hit = caster.First(from, to - from, 0, 1)) {
      const Eigen::Vector3d point = from + hit->t * (to - from);
      ASSERT_NEAR(point.z(), HeightAt(field_, point.head<2>()), 1e-12);
      ++hits;
    }
  }
  EXPECT_EQ(hits, 2000);  // every ray ends below the surface
}

TEST_F(RoughSurface, IsMetAtTheFirstPointByFineSteps) {
  const SurfaceCaster caster(field_);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int k = 0; k < 200; ++k) {
    // Grazing rays, which may pass over one crest and meet the next.
    const Eigen::Vector3d from(0, 0.7 * unit(random), 0.45), to(1, 0.7 * unit(random), 0.15 + 0.2 * unit(random));
    const auto hit = caster.First(from, to - from, 0, 1);
    const double end = hit ? hit->t : 1.0;
    for (double t = 0; t < end - 1e-6; t += 2e-4) {
      const Eigen::Vector3d point = from + t * (to - from);
      ASSERT_GT(point.z(), HeightAt(field_, point.head<2>()) - 1e-12) << "missed at t = " << t << " of " << end;
    }
  }
}

TEST_F(RoughSurface, GivesTheSlopeWhereItIsMet) {
  const SurfaceCaster caster(field_);
  const Eigen::Vector3d from(0.413, 0.307, 1);
  const auto hit = caster.First(from, {0, 0, -1}, 0, 1);
  ASSERT_TRUE(hit);
  constexpr double kStep = 1e-5;  // stays in the cell, where the slope along an axis is constant
  EXPECT_NEAR(hit->slope.x(), (HeightAt(field_, {0.413 + kStep, 0.307}) - HeightAt(field_, {0.413, 0.307})) / kStep,
              1e-9);
  EXPECT_NEAR(hit->slope.y(), (HeightAt(field_, {0.413, 0.307 + kStep}) - HeightAt(field_, {0.413, 0.307})) / kStep,
              1e-9);
}

TEST_F(RoughSurface, IsNotMetByARayThatRises) {
  const SurfaceCaster caster(field_);
  EXPECT_FALSE(caster.First({0.5, 0.3, 0.6}, {0.1, 0, 1}, 0, 10));
}

}  // namespace
}  // namespace granary
