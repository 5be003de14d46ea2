#include "pipeline/edge_limit.h"

#include <gtest/gtest.h>

#include "pipeline/delaunay.h"

namespace granary {
namespace {

/// Points every 4 mm for x below 1 m, every 8 mm beyond.
std::vector<Eigen::Vector2d> TwoDensities() {
  std::vector<Eigen::Vector2d> plan;
  for (double y = 0; y < 1; y += 0.004) {
    for (double x = 0; x < 1; x += 0.004) plan.emplace_back(x, y);
  }
  for (double y = 0; y < 1; y += 0.008) {
    for (double x = 1.008; x < 2; x += 0.008) plan.emplace_back(x, y);
  }
  return plan;
}

TEST(LocalSpacing, FollowsTheDensityOfThePoints) {
  const auto plan = TwoDensities();
  const LocalSpacing spacing(plan, TriangulateDelaunay(plan), 0.004);
  EXPECT_NEAR(spacing.At({0.5, 0.5}), 0.004, 1e-6);  // floats
  EXPECT_NEAR(spacing.At({1.5, 0.5}), 0.008, 1e-6);
}

TEST(LocalSpacing, APlaceWithoutTrianglesHasTheMedianOfAll) {
  std::vector<Eigen::Vector2d> plan = TwoDensities();
  std::erase_if(plan, [](const auto& p) { return p.x() > 0.3 && p.x() < 0.8; });
  const LocalSpacing spacing(plan, TriangulateDelaunay(plan), 0.004);
  EXPECT_DOUBLE_EQ(spacing.At({0.55, 0.5}), spacing.Median_m());
}

TEST(LocalSpacing, WithoutTrianglesItIsTheTypicalOne) {
  EXPECT_DOUBLE_EQ(LocalSpacing({}, {}, 0.004).At({1, 1}), 0.004);
}

TEST(LocalSpacing, DuplicatesAloneLeaveTheTypicalOne) {
  const std::vector<Eigen::Vector2d> plan(3, Eigen::Vector2d(1, 1));
  const std::vector<std::array<std::uint32_t, 3>> triangles{{0, 1, 2}};
  EXPECT_DOUBLE_EQ(LocalSpacing(plan, triangles, 0.004).At({1, 1}), 0.004);
}

}  // namespace
}  // namespace granary
