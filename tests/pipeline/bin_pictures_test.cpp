// The pictures of the bin show what they are given where they should: checked by looking at single pixels.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/colours.h"
#include "pipeline/pictures.h"
#include "pipeline/removed.h"

namespace granary {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

Bin PaperBox() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
  bin.height_m = 0.285;
  return bin;
}

/// A grid over the box, `height(x, y)` metres; completed where x exceeds `completed_from_m`.
template <typename Height>
Surface Grid(Height&& height, double completed_from_m) {
  Surface surface;
  constexpr int kColumns = 53, kRows = 36;
  for (int row = 0; row < kRows; ++row) {
    for (int col = 0; col < kColumns; ++col) {
      const double x = 0.52 * col / (kColumns - 1), y = 0.355 * row / (kRows - 1);
      surface.vertices_in_world.emplace_back(x, y, height(x, y));
      surface.height_m.push_back(height(x, y));
      surface.interpolated.push_back(x > completed_from_m ? 1 : 0);
    }
  }
  for (std::uint32_t row = 0; row + 1 < kRows; ++row) {
    for (std::uint32_t col = 0; col + 1 < kColumns; ++col) {
      const std::uint32_t at = row * kColumns + col;
      for (const auto& triangle :
           {std::array{at, at + 1, at + kColumns + 1}, std::array{at, at + kColumns + 1, at + kColumns}}) {
        surface.triangles.push_back(triangle);
        std::uint8_t completed = 0;
        for (const std::uint32_t vertex : triangle) completed |= surface.interpolated[vertex];
        surface.triangle_interpolated.push_back(completed);
      }
    }
  }
  return surface;
}

int CountOf(const cv::Mat& picture, const cv::Vec3b& colour) {
  cv::Mat mask;
  cv::inRange(picture, colour, colour, mask);
  return cv::countNonZero(mask);
}

/// The body of a plan begins 90 px right and 52 px down; its footprint a margin further.
cv::Point MapPixel(double x_m, double y_m, int margin_px) {
  const double px_per_m = 900 / 0.52;
  return {90 + margin_px + cvRound(x_m * px_per_m), 52 + margin_px + cvRound((0.355 - y_m) * px_per_m)};
}

/// No colour of the map is grey; lines are.
bool IsGrey(const cv::Vec3b& pixel) {
  const auto [low, high] = std::minmax({pixel[0], pixel[1], pixel[2]});
  return high - low < 45;
}

TEST(HeightPicture, IsWiderThanTallForAWideBox) {
  const cv::Mat picture = HeightPicture(Grid([](double, double) { return 0.1; }, 1), PaperBox(), "flat");
  EXPECT_EQ(picture.type(), CV_8UC3);
  EXPECT_GT(picture.cols, picture.rows);
}
TEST(HeightPicture, HighGrainIsYellowAndLowGrainIsViolet) {
  // The body begins 90 px right and 52 px down, the footprint 24 px further; x runs right, y runs up.
  const cv::Mat picture = HeightPicture(Grid([](double x, double) { return x / 4; }, 1), PaperBox(), "ramp");
  const int middle = 52 + 24 + 300;
  const cv::Vec3b left = picture.at<cv::Vec3b>(middle, 90 + 24 + 20),
                  right = picture.at<cv::Vec3b>(middle, 90 + 24 + 880);
  EXPECT_GT(right[2], 200);  // red share of viridis' yellow end
  EXPECT_LT(left[2], 90);    // and of its violet end
}
TEST(HeightPicture, NorthIsUp) {
  const cv::Mat picture = HeightPicture(Grid([](double, double y) { return y; }, 1), PaperBox(), "ramp");
  EXPECT_GT(picture.at<cv::Vec3b>(52 + 24 + 20, 500)[2], picture.at<cv::Vec3b>(52 + 24 + 590, 500)[2]);
}
TEST(HeightPicture, CompletedGrainIsDotted) {
  const auto flat = [](double, double) { return 0.1; };
  const cv::Mat measured = HeightPicture(Grid(flat, 1), PaperBox(), "t");
  const cv::Mat completed = HeightPicture(Grid(flat, 0.26), PaperBox(), "t");
  // Half of 900 x 614 px, one pixel in nine dotted: some 30 000 more white pixels.
  EXPECT_GT(CountOf(completed, {255, 255, 255}), CountOf(measured, {255, 255, 255}) + 25'000);
}
TEST(HeightPicture, FloorWithoutGrainIsGrey) {
  EXPECT_GT(CountOf(HeightPicture(Surface{}, PaperBox(), "empty"), {205, 205, 205}), 500'000);
}
TEST(HeightPicture, ExcludedFloorIsHatched) {
  Bin bin = PaperBox();
  bin.exclude_m = {{{0.1, 0.1}, {0.2, 0.1}, {0.2, 0.2}, {0.1, 0.2}}};
  EXPECT_GT(CountOf(HeightPicture(Surface{}, bin, "t"), {90, 90, 90}), 5'000);
}
TEST(HeightPicture, FootprintWithoutCornersIsRefused) {
  EXPECT_THROW(static_cast<void>(HeightPicture(Surface{}, Bin{}, "t")), std::invalid_argument);
}
TEST(HeightPicture, ContoursOfAConeAreWhereTheirHeightsAre) {
  const auto cone = [](double x, double y) { return 0.17 - 0.5 * std::hypot(x - 0.26, y - 0.1775); };
  const cv::Mat picture = HeightPicture(Grid(cone, 1), PaperBox(), "cone");
  const cv::Point centre = MapPixel(0.26, 0.1775, 24);
  // Lines every 0.02 m, down to 0.04 m at the ends of the ray: every 0.04 m of radius, 69.2 px, beginning where the
  // cone is 0.16 m high. Smoothing moves them by less than a pixel, the grid's straight sides and rounding by another.
  std::vector<double> expected;
  for (double radius_m = 0.02; radius_m < 0.25; radius_m += 0.04) expected.push_back(radius_m * 900 / 0.52);
  std::vector<bool> seen(expected.size(), false);
  for (int radius = 26; radius < 440; ++radius) {  // the tip's own line is bent by the smoothing
    if (!IsGrey(picture.at<cv::Vec3b>(centre.y, centre.x - radius))) continue;
    const auto nearest = std::min_element(expected.begin(), expected.end(), [&](double a, double b) {
      return std::abs(a - radius) < std::abs(b - radius);
    });
    if (nearest == expected.begin()) continue;
    EXPECT_NEAR(radius, *nearest, 3.0);
    seen[static_cast<std::size_t>(nearest - expected.begin())] = true;
  }
  EXPECT_EQ(std::count(seen.begin(), seen.end(), true), static_cast<std::ptrdiff_t>(expected.size()) - 1);
}
TEST(HeightPicture, AFlatSurfaceHasNoContours) {
  // Bumps of 0.2 mm, 20 mm long, in a bin 285 mm high: lines through them would tell nothing.
  const auto bumps = [](double x, double y) { return 0.1 + 0.0002 * std::sin(314 * x) * std::sin(314 * y); };
  const cv::Mat picture = HeightPicture(Grid(bumps, 1), PaperBox(), "flat");
  int grey = 0;
  for (int x = 40; x < 860; ++x) grey += IsGrey(picture.at<cv::Vec3b>(52 + 24 + 307, 90 + 24 + x)) ? 1 : 0;
  EXPECT_EQ(grey, 0);
}
/// Grey pixels of the bin itself, without its outline: a flat surface has no lines and labels, whose edges may be grey.
int CountGreyInBin(const Surface& surface) {
  const cv::Mat picture = HeightPicture(surface, PaperBox(), "flat");
  return CountOf(picture(cv::Rect(90 + 24 + 3, 52 + 24 + 3, 900 - 6, 614 - 6)), {205, 205, 205});
}
TEST(HeightPicture, LeavesNoHoleInsideTheBin) {
  EXPECT_EQ(CountGreyInBin(Grid([](double, double) { return 0.1; }, 1)), 0);
}
TEST(HeightPicture, AHoleInTheSurfaceIsGrey) {
  Surface surface = Grid([](double, double) { return 0.1; }, 1);
  surface.triangles.erase(surface.triangles.begin() + 1800, surface.triangles.begin() + 1802);  // one cell of 10 mm
  surface.triangle_interpolated.resize(surface.triangles.size());
  EXPECT_NEAR(CountGreyInBin(surface), 17.3 * 17.6, 35);  // a pixel more or less on either side
}

/// Of shaded grain and of shaded completion: the hue stays, edges and text are grey.
struct MeshColours {
  int measured = 0, completed = 0;
  double measured_column = 0, completed_column = 0;
};
MeshColours CountMeshColours(const cv::Mat& picture) {
  MeshColours out;
  for (int y = 53; y < picture.rows - 60; ++y) {  // without title and legend
    for (int x = 0; x < picture.cols; ++x) {
      const auto& pixel = picture.at<cv::Vec3b>(y, x);
      if (pixel[2] > pixel[0] + 40) {
        ++out.measured;
        out.measured_column += x;
      } else if (pixel[0] > pixel[2] + 40) {
        ++out.completed;
        out.completed_column += x;
      }
    }
  }
  out.measured_column /= std::max(1, out.measured);
  out.completed_column /= std::max(1, out.completed);
  return out;
}

TEST(MeshPicture, MeasuredGrainHasItsColour) {
  const MeshColours seen =
      CountMeshColours(MeshPicture(Grid([](double, double) { return 0.1; }, 1), PaperBox(), "measured"));
  EXPECT_GT(seen.measured, 150'000);  // a quarter of a picture of some 1000 x 900 px at least
  EXPECT_EQ(seen.completed, 0);
}
TEST(MeshPicture, CompletedGrainHasItsOwnColourInItsPlace) {
  const MeshColours seen =
      CountMeshColours(MeshPicture(Grid([](double, double) { return 0.1; }, 0.26), PaperBox(), "half"));
  EXPECT_NEAR(static_cast<double>(seen.completed) / seen.measured, 1, 0.1);  // one of 52 columns is mixed
  EXPECT_GT(seen.completed_column, seen.measured_column + 200);              // x runs right
}
TEST(MeshPicture, WhatStandsInFrontHidesWhatLiesBehind) {
  const auto flat = [](double, double) { return 0.0; };
  const auto ridge = [](double, double y) { return y < 0.05 ? 0.28 : 0.0; };
  const auto only_front_is_measured = [](Surface surface) {
    for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
      surface.triangle_interpolated[i] = surface.vertices_in_world[surface.triangles[i][2]].y() > 0.07 ? 1 : 0;
    }
    return surface;
  };
  const int open = CountMeshColours(MeshPicture(only_front_is_measured(Grid(flat, 1)), PaperBox(), "flat")).completed;
  const int hidden =
      CountMeshColours(MeshPicture(only_front_is_measured(Grid(ridge, 1)), PaperBox(), "ridge")).completed;
  EXPECT_LT(hidden, open / 2);
}
TEST(MeshPicture, AnEmptySurfaceShowsTheWalls) {
  EXPECT_GT(CountOf(MeshPicture(Surface{}, PaperBox(), "empty"), {40, 40, 40}), 2'000);
}
TEST(MeshPicture, FootprintWithoutCornersIsRefused) {
  EXPECT_THROW(static_cast<void>(MeshPicture(Surface{}, Bin{}, "t")), std::invalid_argument);
}

cv::Vec3b AsBgr(const Rgb& colour) { return {colour[2], colour[1], colour[0]}; }

TEST(RemovedPicture, ShowsPointsWhereTheyLieInTheColourOfWhy) {
  cv::Mat points(1, 4, CV_32FC3, cv::Scalar::all(kNan));
  points.at<cv::Vec3f>(0, 0) = {0.03F, 0.20F, 0.1F};  // kept, so that the strip along the walls is 30 mm wide
  points.at<cv::Vec3f>(0, 1) = {0.26F, 0.10F, 0.2F};  // over the grain floor
  points.at<cv::Vec3f>(0, 2) = {0.26F, 0.30F, 0.5F};  // above the bin
  const cv::Mat mask = (cv::Mat_<std::uint8_t>(1, 4) << 255, 0, 0, 0);
  const RemovedPoints removed = FindRemoved(points, mask, PaperBox());
  const cv::Mat picture = RemovedPicture(points, mask, removed, PaperBox(), "t");
  EXPECT_EQ(picture.at<cv::Vec3b>(MapPixel(0.03, 0.20, 90)), AsBgr(kKeptColour));
  EXPECT_EQ(picture.at<cv::Vec3b>(MapPixel(0.26, 0.10, 90)), AsBgr(kObjectColour));
  EXPECT_EQ(picture.at<cv::Vec3b>(MapPixel(0.26, 0.30, 90)), AsBgr(kAboveColour));
  EXPECT_EQ(picture.at<cv::Vec3b>(MapPixel(0.40, 0.20, 90)), cv::Vec3b(255, 255, 255));
}
TEST(RemovedPicture, PointsFarFromTheBinAreLeftOut) {
  cv::Mat points(1, 2, CV_32FC3, cv::Scalar::all(1e9F));
  points.at<cv::Vec3f>(0, 1) = {-100, 50, 0};
  const cv::Mat mask = cv::Mat::zeros(1, 2, CV_8UC1);
  const RemovedPoints removed = FindRemoved(points, mask, PaperBox());
  EXPECT_FALSE(RemovedPicture(points, mask, removed, PaperBox(), "t").empty());
}

}  // namespace
}  // namespace granary
