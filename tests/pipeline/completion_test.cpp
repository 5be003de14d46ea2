// Made-up heights whose error is known: planes have none, a bowl leans to one side, waves scatter.
#include "pipeline/completion.h"

#include <cmath>
#include <functional>
#include <random>

#include <gtest/gtest.h>

#include "pipeline/floor.h"

namespace granary {
namespace {

constexpr double kSpacing_m = 0.004, kStrip_m = 0.024;

Bin BoxBin() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {1, 0}, {1, 0.8}, {0, 0.8}};
  bin.height_m = 1;
  return bin;
}

std::vector<Eigen::Vector3d> Measured(const std::function<double(double, double)>& height) {
  std::vector<Eigen::Vector3d> points;
  for (double y = kStrip_m; y < 0.8 - kStrip_m; y += kSpacing_m) {
    for (double x = kStrip_m; x < 1 - kStrip_m; x += kSpacing_m) points.emplace_back(x, y, height(x, y));
  }
  return points;
}

double MeanError_m(const LocalPlanes& planes, const std::vector<Eigen::Vector2d>& places,
                   const std::function<double(double, double)>& height) {
  double sum = 0;
  for (const auto& p : places) sum += *planes.HeightAt(p, 1) - height(p.x(), p.y());
  return sum / static_cast<double>(places.size());
}

double Stated_m(const std::function<double(double, double)>& height, double* actual_m = nullptr) {
  const auto points = Measured(height);
  const LocalPlanes planes(points, 5 * kSpacing_m);
  const auto places = PlacesToComplete(points, BoxBin(), 2 * kSpacing_m);
  if (actual_m != nullptr) *actual_m = MeanError_m(planes, places, height);
  return CompletionDeviation_m(planes, places, 1).value();
}

TEST(CompletionDeviation_m, IsNothingForAPlane) {
  EXPECT_LT(Stated_m([](double x, double y) { return 0.3 + 0.2 * x - 0.1 * y; }),
            1e-8);  // the trace of ridge in the fits
}

TEST(CompletionDeviation_m, FindsTheLeanOfABowl) {
  double actual_m = 0;
  const double stated_m =
      Stated_m([](double x, double y) { return 0.5 * (std::pow(x - 0.5, 2) + std::pow(y - 0.4, 2)); }, &actual_m);
  // The strip bends as the surface beside it does; the mirrored strip is as wide to a cell.
  EXPECT_GT(stated_m, 0.7 * std::abs(actual_m));
  EXPECT_LT(stated_m, 4 * std::abs(actual_m));
}

TEST(CompletionDeviation_m, CoversTheErrorOnRandomHills) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> phase(0, 6.28), turn(0, 3.14);
  int inside = 0;
  constexpr int kHills = 20;
  for (int k = 0; k < kHills; ++k) {
    std::vector<std::array<double, 3>> waves;
    for (int i = 0; i < 12; ++i) waves.push_back({turn(random), phase(random), 0.15 + 0.03 * i});
    const auto height = [&](double x, double y) {
      double sum = 0.3;
      for (const auto& [t, p, length] : waves) {
        sum += 0.003 * std::sin(6.28 * (x * std::cos(t) + y * std::sin(t)) / length + p);
      }
      return sum;
    };
    double actual_m = 0;
    inside += 2 * Stated_m(height, &actual_m) >= std::abs(actual_m);
  }
  EXPECT_GE(inside, kHills * 8 / 10);  // 95 % expected: fewer than 16 of 20 has a chance of 1 in 400
}

TEST(CompletionDeviation_m, IsUnknownWithoutASurfaceToMirrorInto) {
  const std::vector<Eigen::Vector3d> few{{0.5, 0.4, 0.1}, {0.51, 0.4, 0.1}};
  const LocalPlanes planes(few, 0.02);
  EXPECT_FALSE(CompletionDeviation_m(planes, PlacesToComplete(few, BoxBin(), 0.02), 1));
}

TEST(SteepestSlope, IsTheAngleOfReposeWhereItIsKnown) {
  Bin bin = BoxBin();
  EXPECT_DOUBLE_EQ(SteepestSlope(bin), 1);
  bin.grain.angle_of_repose_deg = 30;
  EXPECT_NEAR(SteepestSlope(bin), 0.57735, 1e-5);
}

}  // namespace
}  // namespace granary
