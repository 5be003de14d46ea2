#include "pipeline/types/bin_faults.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace granary {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Polygon Box(double x_m, double y_m, double width_m, double depth_m) {
  return {{x_m, y_m}, {x_m + width_m, y_m}, {x_m + width_m, y_m + depth_m}, {x_m, y_m + depth_m}};
}

Bin Bay() {
  Bin bin;
  bin.footprint_m = Box(0, 0, 24, 12);
  bin.height_m = 6;
  return bin;
}

TEST(PolygonFault, AcceptsEitherWinding) {
  Polygon clockwise = Box(0, 0, 1, 2);
  std::reverse(clockwise.begin(), clockwise.end());
  EXPECT_EQ(PolygonFault(Box(0, 0, 1, 2)), "");
  EXPECT_EQ(PolygonFault(clockwise), "");
}

TEST(PolygonFault, AcceptsConcaveFloors) {
  EXPECT_EQ(PolygonFault({{0, 0}, {3, 0}, {3, 3}, {2, 3}, {2, 1}, {0, 1}}), "");
}

TEST(PolygonFault, RefusesABowTie) {
  EXPECT_THAT(PolygonFault({{0, 0}, {1, 1}, {1, 0}, {0, 1}}), HasSubstr("crosses itself"));
}

TEST(PolygonFault, RefusesASpike) {
  EXPECT_THAT(PolygonFault({{0, 0}, {1, 0}, {1, 1}, {1, 2}, {1, 1.5}, {0, 1}}), HasSubstr("touches itself"));
}

TEST(PolygonFault, RefusesTheFirstCornerAgainAtTheEnd) {
  EXPECT_THAT(PolygonFault({{0, 0}, {1, 0}, {1, 1}, {0, 0}}), HasSubstr("repeats a corner"));
}

TEST(PolygonFault, RefusesWhatIsNoNumber) {
  EXPECT_THAT(PolygonFault({{0, 0}, {1, 0}, {1, std::numeric_limits<double>::quiet_NaN()}}), HasSubstr("out of range"));
}

TEST(Faults, AcceptsPillarsThatTouchTheWall) {
  Bin bin = Bay();
  bin.exclude_m = {Box(0, 0, 1, 1), Box(1, 0, 1, 1), Box(10, 5, 0.4, 0.4)};
  EXPECT_THAT(Faults(bin), IsEmpty());
}

TEST(Faults, RefusesAPillarAcrossANotch) {
  Bin bin = Bay();
  bin.footprint_m = {{0, 0}, {3, 0}, {3, 3}, {2, 3}, {2, 1}, {1, 1}, {1, 3}, {0, 3}};
  bin.exclude_m = {{{0.5, 2}, {2.5, 2}, {2.5, 2.5}, {0.5, 2.5}}};
  EXPECT_THAT(Faults(bin), ElementsAre(HasSubstr("exclude_m[0]: leaves the footprint")));
}

TEST(Faults, RefusesOverlappingPillars) {
  Bin bin = Bay();
  bin.exclude_m = {Box(1, 1, 2, 2), Box(2, 2, 2, 2)};
  EXPECT_THAT(Faults(bin), ElementsAre(HasSubstr("exclude_m[1]: overlaps exclude_m[0]")));
}

TEST(Faults, RefusesTheSamePillarTwice) {
  Bin bin = Bay();
  bin.exclude_m = {Box(1, 1, 2, 2), Box(1, 1, 2, 2)};
  EXPECT_THAT(Faults(bin), ElementsAre(HasSubstr("exclude_m[1]: overlaps exclude_m[0]")));
}

TEST(Faults, RefusesABinWithoutFloor) {
  Bin bin = Bay();
  bin.exclude_m = {bin.footprint_m};
  EXPECT_THAT(Faults(bin), ElementsAre(HasSubstr("leaves no floor")));
}

TEST(Faults, AcceptsUnknownBookData) { EXPECT_THAT(Faults(Inventory{}), IsEmpty()); }

}  // namespace
}  // namespace granary
