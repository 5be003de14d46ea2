#include "drivers/sim/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/calibration_file.h"
#include "tests/drivers/sim_worlds.h"

namespace granary {
namespace {

bool Same(const cv::Mat& a, const cv::Mat& b) { return a.size() == b.size() && cv::norm(a, b, cv::NORM_INF) == 0; }

// Mean local deviation over mean local brightness in the middle quarter of a picture.
double SpeckleContrast(const cv::Mat& image) {
  cv::Mat grey, mean, square;
  image(cv::Rect(image.cols / 4, image.rows / 4, image.cols / 2, image.rows / 2)).convertTo(grey, CV_32F);
  cv::boxFilter(grey, mean, -1, {15, 15});
  cv::boxFilter(grey.mul(grey), square, -1, {15, 15});
  cv::Mat deviation;
  cv::sqrt(cv::max(square - mean.mul(mean), 0), deviation);
  return cv::mean(deviation)[0] / cv::mean(mean)[0];
}

// Where a world point appears in a camera of the world, with OpenCV's own projection.
cv::Point2d Project(const RigWorld& world, Side side, const Eigen::Vector3d& point) {
  const Eigen::Vector3d in_left = world.world_from_left.inverse() * point;
  const std::vector<cv::Point3d> points{{in_left.x(), in_left.y(), in_left.z()}};
  const StereoCalibration& c = world.calibration;
  std::vector<cv::Point2d> pixels;
  if (side == Side::kLeft) {
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), c.K1, c.D1, pixels);
  } else {
    cv::Vec3d rotation;
    cv::Rodrigues(c.R, rotation);
    cv::projectPoints(points, rotation, c.T_m, c.K2, c.D2, pixels);
  }
  return pixels[0];
}

Eigen::Vector3d CentreOf(const RigWorld& world, Side side) {
  if (side == Side::kLeft) return world.world_from_left.translation();
  const cv::Vec3d c = -(world.calibration.R.t() * world.calibration.T_m);
  return world.world_from_left * Eigen::Vector3d(c[0], c[1], c[2]);
}

// The solid scene, said again in the simplest way: is this point inside something?
bool IsSolid(const RigWorld& world, const HeightField& surface, const Eigen::Vector3d& p) {
  constexpr double kWall_m = 0.005;  // walls are thicker, but only their inner 5 mm matter to a ray that ends inside
  if (p.z() < 0) return true;
  if (p.z() > world.bin.height_m) return false;
  const Eigen::Vector2d at = p.head<2>();
  for (const auto& pillar : world.bin.exclude_m) {
    if (Contains(pillar, at)) return true;
  }
  if (Contains(world.bin.footprint_m, at)) return p.z() < HeightAt(surface, at);
  const auto& far = world.bin.footprint_m[2];
  return at.x() > -kWall_m && at.y() > -kWall_m && at.x() < far.x() + kWall_m && at.y() < far.y() + kWall_m;
}

struct SceneCase {
  const char* name;
  RigWorld world;
  SimOptions options;
};

std::vector<SceneCase> SceneCases() {
  SimOptions partial;
  partial.shape = SimShape::kPartial;
  SimOptions rough = WarehouseOptions();
  rough.shape = SimShape::kTiltedLeft;
  return {{"LabConvex", SmallLabWorld(), {}},
          {"LabPartial", SmallLabWorld(), partial},
          {"WarehouseConvex", SmallWarehouseWorld(), WarehouseOptions()},
          {"WarehouseTilted", SmallWarehouseWorld(), rough}};
}

class SceneTruth : public testing::TestWithParam<SceneCase> {
 protected:
  // Calls `use` with random pixels of both cameras and what they see.
  template <typename F>
  void ForRandomPixels(int count, F use) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> x(0, 639), y(0, 511);
    for (int k = 0; k < count; ++k) {
      const Side side = k % 2 == 0 ? Side::kLeft : Side::kRight;
      const cv::Point2d pixel(x(random), y(random));
      const SeenPoint seen = scene_.PointSeenBy(side, pixel);
      if (seen.surface != SceneSurface::kNothing) use(side, pixel, seen);
    }
  }
  SimScene scene_{GetParam().options, GetParam().world};
};

INSTANTIATE_TEST_SUITE_P(Bins, SceneTruth, testing::ValuesIn(SceneCases()),
                         [](const auto& bin) { return std::string(bin.param.name); });

TEST_P(SceneTruth, ProjectsBackToThePixel) {
  ForRandomPixels(400, [&](Side side, const cv::Point2d& pixel, const SeenPoint& seen) {
    ASSERT_LT(cv::norm(Project(GetParam().world, side, seen.point_in_world) - pixel), 1e-3);
  });
}

TEST_P(SceneTruth, LiesOnTheSurfaceItNames) {
  const Polygon& footprint = GetParam().world.bin.footprint_m;
  constexpr double kExact_m = 1e-9;
  int grain = 0;
  ForRandomPixels(400, [&](Side, const cv::Point2d&, const SeenPoint& seen) {
    const Eigen::Vector3d& p = seen.point_in_world;
    switch (seen.surface) {
      case SceneSurface::kGrain:
        ASSERT_NEAR(p.z(), HeightAt(scene_.Surface(), p.head<2>()), kExact_m);
        ++grain;
        break;
      case SceneSurface::kFloor:
      case SceneSurface::kGround:
        ASSERT_NEAR(p.z(), 0, kExact_m);
        break;
      case SceneSurface::kRim:
        ASSERT_NEAR(p.z(), GetParam().world.bin.height_m, kExact_m);
        ASSERT_FALSE(Contains(footprint, p.head<2>()));
        break;
      default:
        ASSERT_LE(p.z(), GetParam().world.bin.height_m + kExact_m);
    }
  });
  EXPECT_GT(grain, 100);
}

TEST_P(SceneTruth, IsTheFirstThingOnTheRay) {
  const RigWorld& world = GetParam().world;
  ForRandomPixels(120, [&](Side side, const cv::Point2d& pixel, const SeenPoint& seen) {
    if (!Contains(world.bin.footprint_m, seen.point_in_world.head<2>())) return;
    const Eigen::Vector3d from = CentreOf(world, side), way = seen.point_in_world - from;
    const double step = 0.0015 / 1.1;  // finer than any wall of IsSolid
    for (double t = step; t < 1 - 1e-4; t += step) {
      ASSERT_FALSE(IsSolid(world, scene_.Surface(), from + t * way)) << pixel << " at " << t;
    }
  });
}

TEST_P(SceneTruth, IsTheVolumeAskedFor) {
  const double asked = GetParam().options.volume_m3;
  EXPECT_NEAR(scene_.TruthVolume_m3(), asked, 1e-9 * asked);
}

TEST(SimScene, ShowsTheSameDotsToBothCamerasAtThePlacesTheTruthSays) {
  const RigWorld world = SmallLabWorld();
  SimOptions options;
  options.full_well_e = 1e6;  // hardly any noise
  options.read_noise_e = 0;
  SimScene scene(options, world);
  const FramePair pair = scene.Render(1);
  cv::Mat right;
  pair.right.image.convertTo(right, CV_32F);
  // Correlate a patch of the left picture with the right one at the places that the truth gives, and one pixel aside.
  double at_truth = 0, offset_px = 0;
  int patches = 0;
  for (int y = 180; y < 340; y += 23) {
    for (int x = 230; x < 420; x += 23) {
      constexpr int kHalf = 5;
      std::array<double, 3> score{};
      for (int shift = -1; shift <= 1; ++shift) {
        cv::Mat a(11, 11, CV_32F), map_x(11, 11, CV_32F), map_y(11, 11, CV_32F), b;
        for (int j = -kHalf; j <= kHalf; ++j) {
          for (int i = -kHalf; i <= kHalf; ++i) {
            const SeenPoint seen = scene.PointSeenBy(Side::kLeft, cv::Point2d(x + i, y + j));
            const cv::Point2d there = Project(world, Side::kRight, seen.point_in_world);
            a.at<float>(j + kHalf, i + kHalf) = pair.left.image.at<std::uint8_t>(y + j, x + i);
            map_x.at<float>(j + kHalf, i + kHalf) = static_cast<float>(there.x + shift);
            map_y.at<float>(j + kHalf, i + kHalf) = static_cast<float>(there.y);
          }
        }
        cv::remap(right, b, map_x, map_y, cv::INTER_CUBIC);
        a -= cv::mean(a)[0];
        b -= cv::mean(b)[0];
        score[shift + 1] = a.dot(b) / std::sqrt(a.dot(a) * b.dot(b));
      }
      at_truth += score[1];
      offset_px += 0.5 * (score[0] - score[2]) / (score[0] - 2 * score[1] + score[2]);
      ++patches;
    }
  }
  EXPECT_GT(at_truth / patches, 0.97);
  EXPECT_NEAR(offset_px / patches, 0, 0.02);  // 63 patches of 0.05 px each: three deviations
}

TEST(SimScene, GivesEqualFramesForEqualSeeds) {
  SimScene a({}, SmallLabWorld()), b({}, SmallLabWorld());
  const FramePair one = a.Render(5), other = b.Render(5);
  EXPECT_TRUE(Same(one.left.image, other.left.image));
  EXPECT_TRUE(Same(one.right.image, other.right.image));
}

TEST(SimScene, GivesOtherFramesForOtherSeeds) {
  SimOptions options;
  options.seed = 2;
  SimScene a({}, SmallLabWorld()), b(options, SmallLabWorld());
  EXPECT_FALSE(Same(a.Render(5).left.image, b.Render(5).left.image));
}

TEST(SimScene, GivesEachShotItsOwnNoiseOfTheSameSize) {
  SimScene scene({}, SmallLabWorld());
  cv::Mat a, b;
  scene.Render(1).left.image.convertTo(a, CV_32F);
  scene.Render(2).left.image.convertTo(b, CV_32F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(a - b, mean, deviation);
  EXPECT_NEAR(mean[0], 0, 0.02);  // 330 000 pixels of 1.5 grey levels
  EXPECT_GT(deviation[0], 0.5);   // read noise alone: 12 e of 9000 e at 255, √2 of it for a difference
  EXPECT_LT(deviation[0], 4);     // a full pixel: √9000 e, √2
}

TEST(SimScene, RepeatsAShotWhateverWasShotBefore) {
  SimScene scene({}, SmallLabWorld());
  const FramePair first = scene.Render(1);
  (void)scene.Render(2, false);
  EXPECT_TRUE(Same(scene.Render(1).left.image, first.left.image));
}

TEST(SimScene, DoesNotDependOnTheNumberOfThreads) {
  SimScene many({}, SmallLabWorld());
  const cv::Mat expected = many.Render(1).left.image;
  const tbb::global_control alone(tbb::global_control::max_allowed_parallelism, 1);
  SimScene one({}, SmallLabWorld());
  EXPECT_TRUE(Same(one.Render(1).left.image, expected));
}

TEST(SimScene, ShowsDotsWhenLitAndNoneWhenNot) {
  SimScene scene({}, SmallLabWorld());
  EXPECT_GT(SpeckleContrast(scene.Render(1).left.image), 0.35);
  EXPECT_LT(SpeckleContrast(scene.Render(1, false).left.image), 0.10);  // noise and the grain's own mottle
}

TEST(SimScene, ShowsNoDotsWhenTheProjectorIsBroken) {
  SimOptions options;
  options.projector_works = false;
  SimScene broken(options, SmallLabWorld()), sound({}, SmallLabWorld());
  EXPECT_TRUE(Same(broken.Render(1).left.image, sound.Render(1, false).left.image));
}

TEST(SimScene, HasDotsThatNearlyFillTheScaleAndDoNotClipIt) {
  SimOptions options;
  options.shape = SimShape::kFlat;
  SimScene scene(options, SmallLabWorld());
  const cv::Mat grain = scene.Render(1).left.image(cv::Rect(240, 180, 160, 140)).clone();
  std::vector<std::uint8_t> greys(grain.begin<std::uint8_t>(), grain.end<std::uint8_t>());
  std::sort(greys.begin(), greys.end());
  EXPECT_NEAR(greys[greys.size() * 99 / 100] / 255.0, 0.77, 0.08);
  EXPECT_LT(std::count(greys.begin(), greys.end(), 255), static_cast<long>(greys.size() / 1000));
}

TEST(SimScene, ScalesWithExposureAndGain) {
  SimScene scene({}, SmallLabWorld());
  const auto mean = [&](SimExposure exposure) {
    return cv::mean(scene.RenderSide(Side::kLeft, 1, false, exposure).image)[0];
  };
  const double normal = mean({8000, 0});
  EXPECT_NEAR(mean({16000, 0}), 2 * normal, 0.02 * normal);
  EXPECT_NEAR(mean({8000, 20 * std::log10(2.0)}), 2 * normal, 0.04 * normal);  // rounding and clipping at 0
}

TEST(SimScene, ShowsTheRightCameraALittleDarker) {
  SimScene scene({}, SmallLabWorld());
  const FramePair pair = scene.Render(1);
  EXPECT_NEAR(cv::mean(pair.right.image)[0] / cv::mean(pair.left.image)[0], 0.95, 0.05);
}

TEST(SimScene, MarksItsFramesAsSimulatedEightBitGrey) {
  SimScene scene({}, SmallLabWorld());
  const FramePair pair = scene.Render(4);
  EXPECT_TRUE(pair.left.simulated && pair.right.simulated);
  EXPECT_EQ(pair.left.image.type(), CV_8UC1);
  EXPECT_EQ(pair.left.image.size(), cv::Size(640, 512));
  EXPECT_EQ(pair.right.frame_id, 4u);
}

TEST(SimScene, ShowsTheFloorOfAnEmptyBin) {
  RigWorld world = SmallLabWorld();
  world.empty_bin = true;
  const SimScene scene({}, world);
  EXPECT_EQ(scene.TruthVolume_m3(), 0);
  EXPECT_EQ(scene.PointSeenBy(Side::kLeft, {320, 256}).surface, SceneSurface::kFloor);
}

TEST(SimScene, HidesTheFloorBehindTheNearWall) {
  RigWorld world = SmallLabWorld();
  world.empty_bin = true;
  world.world_from_left.translation().y() = -0.35;  // the cameras look straight down outside the box
  SimScene scene({}, world);
  const Eigen::Vector3d hidden(0.26, 0.02, 0);  // at the foot of the near wall
  const SeenPoint seen = scene.PointSeenBy(Side::kLeft, Project(world, Side::kLeft, hidden));
  EXPECT_TRUE(seen.surface == SceneSurface::kWall || seen.surface == SceneSurface::kRim);
  EXPECT_LT(seen.point_in_world.y(), 0);
}

TEST(SimScene, LeavesTheProjectorsShadowToAmbientLight) {
  SimScene scene({}, SmallLabWorld());  // the box throws a shadow on the ground beside it
  const FramePair lit = scene.Render(1), dark = scene.Render(1, false);
  int shadowed = 0;
  for (int y = 4; y < 508; ++y) {
    for (int x = 4; x < 636; ++x) {
      bool all = true;
      for (const auto& [dx, dy] : {std::pair{-3, -3}, {3, -3}, {-3, 3}, {3, 3}, {0, 0}}) {
        all = all && !scene.PointSeenBy(Side::kLeft, cv::Point2d(x + dx, y + dy)).reached_by_projector;
        if (!all) break;
      }
      if (!all) continue;
      ++shadowed;
      ASSERT_EQ(lit.left.image.at<std::uint8_t>(y, x), dark.left.image.at<std::uint8_t>(y, x)) << x << ", " << y;
    }
  }
  EXPECT_GT(shadowed, 100);
}

TEST(SimScene, AdvancesByItsMotion) {
  SimOptions options;
  options.motion = SimMotion::kFilling;
  options.volume_step_m3 = 0.001;
  SimScene scene(options, SmallLabWorld());
  const cv::Mat before = scene.Render(1).left.image;
  scene.Advance();
  EXPECT_NEAR(scene.TruthVolume_m3(), 0.020, 1e-12);
  EXPECT_FALSE(Same(scene.Render(1).left.image, before));
}

TEST(SimScene, FillsNoHigherThanItsCameras) {
  SimOptions options = WarehouseOptions();
  options.motion = SimMotion::kFilling;
  options.volume_step_m3 = 2000;
  SimScene scene(options, SmallWarehouseWorld());
  scene.Advance();
  const auto& z = scene.Surface().z_m;
  EXPECT_LT(*std::max_element(z.begin(), z.end()), 9.0);
}

TEST(SimScene, RefusesMoreGrainThanFits) {
  SimOptions options;
  options.volume_m3 = 1;
  EXPECT_THROW(SimScene(options, SmallLabWorld()), std::invalid_argument);
}

TEST(SimScene, RefusesACameraInsideAWall) {
  RigWorld world = SmallWarehouseWorld();
  world.world_from_left.translation().x() = -0.1;
  EXPECT_THROW(SimScene(WarehouseOptions(), world), std::invalid_argument);
}

TEST(SimScene, RefusesARigThatLooksAway) {
  RigWorld world = SmallLabWorld();
  world.world_from_left.linear() = Eigen::Matrix3d::Identity();  // z up
  EXPECT_THROW(SimScene({}, world), std::invalid_argument);
}

TEST(SimScene, RefusesADistortionThatFoldsThePicture) {
  RigWorld world = SmallLabWorld();
  world.calibration.D2 = {-3, 0, 0, 0, 0};
  try {
    SimScene scene({}, world);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("right camera"));
  }
}

TEST(SimScene, SeesTheWholeBoxWithTheShippedCalibration) {
  const std::filesystem::path folder = std::filesystem::path(GRANARY_SOURCE_DIR) / "config" / "sim";
  RigWorld world = SmallLabWorld();
  world.calibration = LoadStereoCalibration(folder / "stereo.yml");
  world.world_from_left = LoadWorldFromLeft(folder / "world.yml");
  for (const Side side : {Side::kLeft, Side::kRight}) {
    for (const auto& corner : world.bin.footprint_m) {
      for (const double z : {0.0, world.bin.height_m}) {
        const cv::Point2d pixel = Project(world, side, {corner.x(), corner.y(), z});
        EXPECT_TRUE(cv::Rect2d(20, 20, 1240, 984).contains(pixel)) << pixel;
      }
    }
  }
}

}  // namespace
}  // namespace granary
