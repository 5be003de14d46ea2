#include "drivers/sim/stage.h"

#include <chrono>
#include <future>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/drivers/sim_worlds.h"

namespace granary {
namespace {

using std::chrono::milliseconds;

constexpr UtcTime kStart{std::chrono::seconds{1'000'000}};

SimOptions Draining() {
  SimOptions options;
  options.motion = SimMotion::kDraining;
  options.volume_step_m3 = 0.0005;
  return options;
}

bool Same(const Frame& a, const Frame& b) {
  return a.image.size() == b.image.size() && cv::norm(a.image, b.image, cv::NORM_INF) == 0;
}

TEST(TakePicture, GivesBothSidesOneShot) {
  SimStage stage(Draining(), SmallLabWorld());
  const Frame left = stage.TakePicture(Side::kLeft, kStart, {});
  const Frame right = stage.TakePicture(Side::kRight, kStart + milliseconds{100}, {});
  EXPECT_EQ(left.frame_id, 1U);
  EXPECT_EQ(right.frame_id, 1U);
  EXPECT_EQ(left.exposure_start, kStart);
  EXPECT_EQ(right.exposure_start, kStart);
}

TEST(TakePicture, ShowsTheSceneOneStepFurtherAfterAPause) {
  SimStage stage(Draining(), SmallLabWorld());
  SimScene scene(Draining(), SmallLabWorld());
  for (std::uint64_t shot = 1; shot <= 3; ++shot) {
    if (shot > 1) scene.Advance();
    const UtcTime when = kStart + shot * (SimStage::kPause + milliseconds{1});
    for (const Side side : {Side::kRight, Side::kLeft}) {
      EXPECT_TRUE(Same(stage.TakePicture(side, when, {4000, 3}), scene.RenderSide(side, shot, true, {4000, 3})))
          << "shot " << shot;
    }
  }
}

TEST(TakePicture, ShowsTheSameSceneWithinAMeasurement) {
  SimStage stage(Draining(), SmallLabWorld());
  SimScene scene(Draining(), SmallLabWorld());
  for (std::uint64_t shot = 1; shot <= 3; ++shot) {
    const Frame frame = stage.TakePicture(Side::kLeft, kStart + shot * SimStage::kPause, {});
    EXPECT_TRUE(Same(frame, scene.RenderSide(Side::kLeft, shot, true, {}))) << "shot " << shot;
  }
}

TEST(TakePicture, BeginsAShotWithTheSecondTriggerOfASide) {
  SimStage stage({}, SmallLabWorld());
  EXPECT_EQ(stage.TakePicture(Side::kLeft, kStart, {}).frame_id, 1U);
  EXPECT_EQ(stage.TakePicture(Side::kLeft, kStart + milliseconds{40}, {}).frame_id, 2U);
  EXPECT_EQ(stage.TakePicture(Side::kRight, kStart + milliseconds{50}, {}).frame_id, 2U);
}

TEST(TakePicture, BeginsAShotWhenTheOtherSideIsLongPast) {
  SimStage stage({}, SmallLabWorld());
  EXPECT_EQ(stage.TakePicture(Side::kLeft, kStart, {}).frame_id, 1U);
  EXPECT_EQ(stage.TakePicture(Side::kRight, kStart + SimStage::kShotSpan + milliseconds{1}, {}).frame_id, 2U);
}

TEST(TakePicture, MovesOnWhereOneSideMissedAShot) {
  SimStage stage(Draining(), SmallLabWorld());
  SimScene scene(Draining(), SmallLabWorld());
  (void)stage.TakePicture(Side::kLeft, kStart, {});
  scene.Advance();
  EXPECT_TRUE(Same(stage.TakePicture(Side::kLeft, kStart + 2 * SimStage::kPause, {}),
                   scene.RenderSide(Side::kLeft, 2, true, {})));
}

TEST(TakePicture, LeavesAnEmptyBinEmpty) {
  RigWorld world = SmallLabWorld();
  world.empty_bin = true;
  SimStage stage(Draining(), world);
  SimScene scene(Draining(), world);
  (void)stage.TakePicture(Side::kLeft, kStart, {});
  EXPECT_TRUE(Same(stage.TakePicture(Side::kLeft, kStart + 2 * SimStage::kPause, {}),
                   scene.RenderSide(Side::kLeft, 2, true, {})));
}

TEST(TakePicture, IsDarkWithoutTheLamp) {
  SimStage stage({}, SmallLabWorld());
  SimScene scene({}, SmallLabWorld());
  stage.SetLamp(false);
  EXPECT_TRUE(Same(stage.TakePicture(Side::kLeft, kStart, {}), scene.RenderSide(Side::kLeft, 1, false, {})));
}

TEST(TakePicture, ServesTwoThreads) {
  SimStage stage(Draining(), SmallLabWorld());
  const auto take = [&](Side side) {
    std::uint64_t last = 0;
    for (int i = 0; i < 3; ++i) last = stage.TakePicture(side, kStart + 2 * i * SimStage::kPause, {}).frame_id;
    return last;
  };
  auto left = std::async(std::launch::async, take, Side::kLeft);
  EXPECT_GE(take(Side::kRight), 3U);  // more where a thread ran ahead of the other
  EXPECT_GE(left.get(), 3U);
}

}  // namespace
}  // namespace granary
