#include "pipeline/delaunay.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "pipeline/predicates.h"

namespace granary {
namespace {

using Points = std::vector<Eigen::Vector2d>;
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

Points RandomPoints(std::size_t count, unsigned seed, double width = 1, double height = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = width * unit(random);
    points.emplace_back(x, height * unit(random));
  }
  return points;
}

/// Points with coordinates from a small set of integers: many duplicates, collinear and cocircular ones.
Points CrowdedPoints(std::size_t count, int span, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> coordinate(0, span);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    const int x = coordinate(random);
    points.emplace_back(x, coordinate(random));
  }
  return points;
}

Points GridPoints(int columns, int rows, double step) {
  Points points;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) points.emplace_back(step * x, step * y);
  }
  return points;
}

double DoubledArea(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
}

double SumOfAreas(const Points& points, const Triangles& triangles) {
  double sum = 0;
  for (const auto& [a, b, c] : triangles) sum += DoubledArea(points[a], points[b], points[c]) / 2;
  return sum;
}

struct Hull {
  double area = 0;
  std::size_t on_border = 0;  ///< distinct points on the hull, those inside its edges included
};

/// Andrew's monotone chain, keeping collinear points; exact turns.
Hull ConvexHull(Points points) {
  const auto less = [](const auto& a, const auto& b) { return std::pair(a.x(), a.y()) < std::pair(b.x(), b.y()); };
  std::sort(points.begin(), points.end(), less);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  Points chain;
  for (int pass = 0; pass < 2; ++pass) {
    const std::size_t start = chain.size();
    for (const auto& point : points) {
      while (chain.size() >= start + 2 && Orientation(chain[chain.size() - 2], chain.back(), point) < 0)
        chain.pop_back();
      chain.push_back(point);
    }
    chain.pop_back();
    std::reverse(points.begin(), points.end());
  }
  Hull hull;
  for (std::size_t i = 0; i < chain.size(); ++i) {
    hull.area += DoubledArea(chain[0], chain[i], chain[(i + 1) % chain.size()]) / 2;
  }
  hull.on_border = chain.size();
  return hull;
}

std::size_t CountDistinct(const Points& points) {
  std::set<std::pair<double, double>> distinct;
  for (const auto& point : points) distinct.emplace(point.x(), point.y());
  return distinct.size();
}

/// Everything that makes a triangulation of the whole hull Delaunay, with exact signs. By Delaunay's lemma it is
/// enough that each edge is locally Delaunay.
void ExpectDelaunay(const Points& points, const Triangles& triangles) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> apex;  // of each directed edge
  std::set<std::uint32_t> used;
  for (const auto& triangle : triangles) {
    ASSERT_GT(Orientation(points[triangle[0]], points[triangle[1]], points[triangle[2]]), 0);
    for (int i = 0; i < 3; ++i) {
      used.insert(triangle[i]);
      ASSERT_TRUE(apex.emplace(std::pair(triangle[i], triangle[(i + 1) % 3]), triangle[(i + 2) % 3]).second)
          << "two triangles on one side of an edge";
    }
  }
  for (const auto& [edge, corner] : apex) {
    const auto other = apex.find({edge.second, edge.first});
    if (other == apex.end()) continue;
    ASSERT_LE(InCircle(points[edge.first], points[edge.second], points[corner], points[other->second]), 0);
  }
  // Euler: with n vertices, h of them on the hull, there are 2 n − 2 − h triangles.
  const Hull hull = ConvexHull(points);
  const std::size_t vertices = CountDistinct(points);
  EXPECT_EQ(used.size(), vertices);
  EXPECT_EQ(triangles.size(), 2 * vertices - 2 - hull.on_border);
  // n sums of rounded terms, each within a few units in the last place of the whole
  EXPECT_NEAR(SumOfAreas(points, triangles), hull.area, 1e-12 * (hull.area + 1));
}

TEST(TriangulateDelaunay, HasEmptyCircumcirclesByBruteForceOnSmallRandomSets) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    const Points points = RandomPoints(3 + seed % 40, seed);
    const Triangles triangles = TriangulateDelaunay(points);
    for (const auto& [a, b, c] : triangles) {
      for (const auto& point : points) ASSERT_LE(ExactInCircle(points[a], points[b], points[c], point), 0);
    }
    ExpectDelaunay(points, triangles);
  }
}

TEST(TriangulateDelaunay, HasEmptyCircumcirclesByBruteForceOnCrowdedIntegers) {
  for (unsigned seed = 0; seed < 600; ++seed) {
    const Points points = CrowdedPoints(4 + seed % 60, 2 + static_cast<int>(seed % 7), seed);
    const Triangles triangles = TriangulateDelaunay(points);
    if (triangles.empty()) {
      EXPECT_EQ(ConvexHull(points).area, 0) << seed;
      continue;
    }
    for (const auto& [a, b, c] : triangles) {
      for (const auto& point : points) ASSERT_LE(ExactInCircle(points[a], points[b], points[c], point), 0);
    }
    ExpectDelaunay(points, triangles);
  }
}

TEST(TriangulateDelaunay, IsDelaunayForAHundredThousandRandomPoints) {
  const Points points = RandomPoints(100'000, 3);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, IsDelaunayOnAPerfectGridOfRepresentableSteps) {
  const Points points = GridPoints(70, 50, 0x1p-8);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, IsDelaunayOnAGridOfRoundedDecimalSteps) {
  const Points points = GridPoints(70, 50, 0.001);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, IsDelaunayForPointsOnACircleAndItsCentre) {
  Points points;
  for (int i = 0; i < 500; ++i) {
    const double angle = 2 * std::numbers::pi * i / 500;
    points.emplace_back(std::cos(angle), std::sin(angle));
  }
  ExpectDelaunay(points, TriangulateDelaunay(points));
  points.emplace_back(0, 0);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, IsDelaunayOnAParabola) {
  Points points;
  for (int i = -200; i <= 200; ++i) points.emplace_back(i, i * i);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, IsDelaunayWithClustersAndAnOutlierFarAway) {
  Points points = RandomPoints(3000, 5, 1e-6, 1e-6);
  for (const auto& point : RandomPoints(3000, 6)) points.push_back(point);
  points.emplace_back(1e9, -3e8);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, IsDelaunayOnAVeryThinStrip) {
  const Points points = RandomPoints(5000, 9, 1, 1e-12);
  ExpectDelaunay(points, TriangulateDelaunay(points));
}

TEST(TriangulateDelaunay, DoesNotDependOnThePlaceOfTheOrigin) {
  Points points = CrowdedPoints(2000, 1000, 11);
  const Triangles here = TriangulateDelaunay(points);
  for (auto& point : points) point += Eigen::Vector2d(1 << 20, -(1 << 20));  // exact
  EXPECT_EQ(TriangulateDelaunay(points), here);
}

TEST(TriangulateDelaunay, UsesTheFirstOfEqualPoints) {
  Points points = RandomPoints(2000, 13);
  const std::size_t distinct = points.size();
  for (int copy = 0; copy < 3; ++copy) {
    for (std::size_t i = 0; i < distinct; ++i) points.push_back(points[i]);
  }
  const Triangles triangles = TriangulateDelaunay(points);
  ExpectDelaunay(points, triangles);
  for (const auto& triangle : triangles) {
    for (const auto corner : triangle) ASSERT_LT(corner, distinct);
  }
}

TEST(TriangulateDelaunay, EndsQuicklyWithThousandsOfCopiesOfFewPoints) {
  const Points points = CrowdedPoints(200'000, 2, 17);  // nine places
  const Triangles triangles = TriangulateDelaunay(points);
  EXPECT_EQ(triangles.size(), 8U);
}

TEST(TriangulateDelaunay, TakesMinusZeroForZero) {
  const Points points = {{0.0, 0.0}, {-0.0, -0.0}, {1, 0}, {0, 1}};
  const Triangles triangles = TriangulateDelaunay(points);
  ASSERT_EQ(triangles.size(), 1U);
  EXPECT_THAT(triangles[0], testing::UnorderedElementsAre(0, 2, 3));
}

TEST(TriangulateDelaunay, MakesNoTriangleOfFewerThanThreePoints) {
  EXPECT_TRUE(TriangulateDelaunay(Points{}).empty());
  EXPECT_TRUE(TriangulateDelaunay(Points{{1, 2}}).empty());
  EXPECT_TRUE(TriangulateDelaunay(Points{{1, 2}, {3, 4}}).empty());
}

TEST(TriangulateDelaunay, MakesNoTriangleOfCollinearPoints) {
  Points points;
  for (int i = 0; i < 1000; ++i) points.emplace_back(i * 0.5, i * 0.25);
  EXPECT_TRUE(TriangulateDelaunay(points).empty());
}

TEST(TriangulateDelaunay, MakesNoTriangleOfEqualPoints) {
  EXPECT_TRUE(TriangulateDelaunay(Points(1000, Eigen::Vector2d(0.3, 0.7))).empty());
}

TEST(TriangulateDelaunay, FansOutFromOnePointBesideALine) {
  Points points;
  for (int i = 0; i < 1000; ++i) points.emplace_back(i, 0);
  points.emplace_back(500.25, 1);
  const Triangles triangles = TriangulateDelaunay(points);
  EXPECT_EQ(triangles.size(), 999U);
  ExpectDelaunay(points, triangles);
}

TEST(TriangulateDelaunay, RefusesNotANumberNamingThePoint) {
  Points points = RandomPoints(10, 1);
  points[7].y() = std::numeric_limits<double>::quiet_NaN();
  try {
    (void)TriangulateDelaunay(points);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("point 7"));
  }
}

TEST(TriangulateDelaunay, RefusesInfinityAndNumbersOutOfRange) {
  for (const double bad : {std::numeric_limits<double>::infinity(), -1e61}) {
    EXPECT_THROW((void)TriangulateDelaunay(Points{{0, 0}, {1, 0}, {bad, 1}}), std::invalid_argument);
  }
}

TEST(TriangulateDelaunay, StandsTheSmallestAndLargestCoordinatesAllowed) {
  for (const double scale : {1e-39, 1e59}) {
    Points points = RandomPoints(300, 21);
    for (auto& point : points) point = (point.array() + 1e-1).matrix() * scale;
    const Triangles triangles = TriangulateDelaunay(points);
    for (const auto& [a, b, c] : triangles) {
      for (const auto& point : points) ASSERT_LE(ExactInCircle(points[a], points[b], points[c], point), 0);
    }
  }
}

}  // namespace
}  // namespace granary
