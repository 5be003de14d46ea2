// The page as a whole, on a small ideal rig that looks straight down on level grain: every disparity is known.
#include "pipeline/pipeline.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <opencv2/core.hpp>

#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

using testing::HasSubstr;

const cv::Size kSize{320, 240};
constexpr double kFocal_px = 330, kBaseline_m = 0.11, kHeight_m = 0.9;

Bin BoxBin() {
  Bin bin;
  bin.id = 3;
  bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
  bin.height_m = 0.285;
  return bin;
}

RigSetup Rig() {
  RigSetup rig;
  rig.name = "a";
  rig.calibration.image_size = kSize;
  rig.calibration.K1 = rig.calibration.K2 = {kFocal_px, 0, 159.5, 0, kFocal_px, 119.5, 0, 0, 1};
  rig.calibration.D1 = rig.calibration.D2 = {0, 0, 0, 0, 0};
  rig.calibration.T_m = {-kBaseline_m, 0, 0};
  rig.world_from_left.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  rig.world_from_left.translation() << 0.26, 0.1775, kHeight_m;
  return rig;
}

Frame FrameOf(const cv::Mat& image, const std::string& source) {
  Frame frame;
  frame.image = image;
  frame.source = source;
  frame.simulated = true;
  return frame;
}
FramePair PairOf(const cv::Mat& left, const cv::Mat& right) {
  FramePair pair;
  pair.left = FrameOf(left, "L.png");
  pair.right = FrameOf(right, "R.png");
  return pair;
}

/// Level grain that fills the picture, walls and all.
FramePair LevelGrain(double level_m, unsigned seed = 1) {
  const double disparity = kFocal_px * kBaseline_m / (kHeight_m - level_m);
  const StereoPair pair = RenderPlane(kSize, {disparity, 0, 0}, 2, seed);
  return PairOf(pair.left, pair.right);
}
FramePair Blank(double grey, int type = CV_8UC1, cv::Size size = kSize) {
  const cv::Mat image(size, type, cv::Scalar::all(grey));
  return PairOf(image, image);
}

Pipeline Empty() { return Pipeline(BoxBin(), {Rig()}, {}); }
Reference SomeReference() { return Empty().TakeReference(0, LevelGrain(0, 7)).reference.value(); }
Pipeline WithReference() {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  PipelineOptions options;
  // In pictures as small as these the strip of a matching window along the walls is 18 % of the floor.
  options.surface.reduced_coverage = 0.75;
  return Pipeline(BoxBin(), {std::move(rig)}, options);
}
Measurement Measure(const Pipeline& pipeline, const FramePair& pair) { return pipeline.Run({pair}, {}).measurement; }

std::string Refusal(RigSetup rig) {
  try {
    const Pipeline pipeline(BoxBin(), {std::move(rig)}, {});
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted";
  return {};
}

void ExpectNoFigure(const Measurement& m) {
  EXPECT_FALSE(m.valid);
  EXPECT_FALSE(m.volume_m3 || m.volume_u95_m3 || m.level_mean_m || m.mass_kg || m.error_rate_percent || m.abnormal);
  EXPECT_FALSE(m.detail.empty());
}

TEST(Pipeline, RefusesABinWithoutARig) { EXPECT_THROW(Pipeline(BoxBin(), {}, {}), std::invalid_argument); }

TEST(Pipeline, RefusesExchangedSidesNamingTheRig) {
  RigSetup rig = Rig();
  rig.calibration.T_m = {kBaseline_m, 0, 0};
  EXPECT_THAT(Refusal(rig), HasSubstr("rig a"));
}

TEST(Pipeline, RefusesAPoseThatLooksAway) {
  RigSetup rig = Rig();
  rig.world_from_left.linear().setIdentity();
  EXPECT_THAT(Refusal(rig), AllOf(HasSubstr("rig a"), HasSubstr("behind the cameras")));
}

TEST(Pipeline, RefusesAReferenceOfAnotherSize) {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  rig.reference->points_in_world = rig.reference->points_in_world.colRange(0, 300).clone();
  EXPECT_THAT(Refusal(rig), AllOf(HasSubstr(rig.reference->id), HasSubstr("picture size")));
}

TEST(Pipeline, RefusesAReferenceOfAnotherRig) {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  rig.calibration.K1(0, 0) += 0.5;
  EXPECT_THAT(Refusal(rig), AllOf(HasSubstr(rig.reference->id), HasSubstr("another calibration or pose")));
}

TEST(Pipeline, RefusesAReferenceTakenFromAnotherPose) {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  rig.world_from_left.translation().z() += 0.001;
  EXPECT_THAT(Refusal(rig), HasSubstr("another calibration or pose"));
}

TEST(Pipeline, RefusesAReferenceWithoutAFloor) {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  rig.reference->points_in_world.setTo(cv::Scalar::all(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_THAT(Refusal(rig), AllOf(HasSubstr("bin 3"), HasSubstr("no level floor")));
}

TEST(Pipeline, NotesAMissingReference) {
  EXPECT_THAT(Empty().Notes(), testing::ElementsAre(HasSubstr("no reference")));
  EXPECT_TRUE(WithReference().Notes().empty());
}

TEST(Pipeline, NotesATopThatIsTooNear) {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  PipelineOptions options;
  options.stereo.max_disparities = 16;
  const Pipeline pipeline(BoxBin(), {rig}, options);
  EXPECT_THAT(pipeline.Notes(), testing::ElementsAre(AllOf(HasSubstr("rig a"), HasSubstr("is not seen"))));
}

TEST(Run, MeasuresLevelGrain) {
  const Measurement m = Measure(WithReference(), LevelGrain(0.1));
  ASSERT_EQ(m.reason, Reason::kOk) << m.detail;
  EXPECT_TRUE(m.valid);
  EXPECT_TRUE(m.simulated);
  EXPECT_FALSE(m.reduced_accuracy) << m.detail;
  EXPECT_EQ(m.bin, 3);
  const double truth = 0.52 * 0.355 * 0.1;
  // One pixel is 18 mm of height here; biases of 0.01 px at the grain and at the floor are 0.4 mm of the 100.
  EXPECT_NEAR(*m.volume_m3, truth, 0.004 * truth);
  EXPECT_LT(std::abs(*m.volume_m3 - truth), *m.volume_u95_m3);
  EXPECT_NEAR(*m.level_mean_m, 0.1, 0.0004);
  EXPECT_NEAR(*m.volume_percent, 100 * 0.1 / 0.285, 0.2);
  EXPECT_NEAR(*m.volume_m3 + *m.free_volume_m3, 0.52 * 0.355 * 0.285, 1e-12);
  EXPECT_NEAR(*m.volume_measured_m3 + *m.volume_interpolated_m3, *m.volume_m3, 1e-12);
}

TEST(Run, AnEmptyBinHoldsNothing) {
  const Measurement m = Measure(WithReference(), LevelGrain(0, 8));
  ASSERT_TRUE(m.valid) << m.detail;
  EXPECT_LT(std::abs(*m.volume_m3), *m.volume_u95_m3);
}

TEST(Run, WithoutAReferenceItMeasuresAndSaysSo) {
  const Measurement m = Measure(Empty(), LevelGrain(0.1));
  ASSERT_TRUE(m.valid) << m.detail;
  EXPECT_TRUE(m.reduced_accuracy);
  EXPECT_THAT(m.detail, HasSubstr("no reference"));
  EXPECT_EQ(m.reference_id, "");
}

TEST(Run, GivesTheSameVolumeAgainAndWithAnyNumberOfThreads) {
  const Pipeline pipeline = WithReference();
  const FramePair pair = LevelGrain(0.1);
  const auto with_threads = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return *Measure(pipeline, pair).volume_m3;
  };
  const double one = with_threads(1);
  EXPECT_EQ(with_threads(1), one);
  EXPECT_EQ(with_threads(2), one);
}

TEST(Run, KeepsEveryIntermediate) {
  const PipelineRun run = WithReference().Run({LevelGrain(0.1)}, {});
  ASSERT_EQ(run.rigs.size(), 1U);
  for (const cv::Mat& mat : {run.rigs[0].left, run.rigs[0].right, run.rigs[0].disparity_px, run.rigs[0].deviation_px,
                             run.rigs[0].points_in_world, run.rigs[0].grain_mask}) {
    EXPECT_EQ(mat.size(), kSize);
  }
  EXPECT_FALSE(run.surface.Empty());
  EXPECT_EQ(run.measurement.triangles, run.surface.triangles.size());
}

/// Level grain with something standing on it: `left_px` says where, as wide as a twentieth of the picture.
FramePair WithVisitor(double level_m, int left_px, unsigned seed) {
  FramePair pair = LevelGrain(level_m, seed);
  const FramePair nearer = LevelGrain(level_m + 0.15, seed + 100);
  const double disparity = kFocal_px * kBaseline_m / (kHeight_m - level_m - 0.15);
  const cv::Rect place(left_px, kSize.height / 3, kSize.width / 10, kSize.height / 4);
  nearer.left.image(place).copyTo(pair.left.image(place));
  const cv::Rect seen(place.x - static_cast<int>(disparity), place.y, place.width, place.height);
  nearer.right.image(seen).copyTo(pair.right.image(seen));
  return pair;
}

TEST(RunShots, SeveralShotsGiveOneFigureWithItsScatter) {
  const Pipeline pipeline = WithReference();
  const Measurement m =
      pipeline.RunShots({{LevelGrain(0.1, 1)}, {LevelGrain(0.1, 2)}, {LevelGrain(0.1, 3)}}, {}).measurement;
  ASSERT_TRUE(m.valid) << m.detail;
  EXPECT_EQ(m.shots, 3);
  ASSERT_TRUE(m.repeatability_rsd_percent);
  EXPECT_GT(*m.repeatability_rsd_percent, 0);
  EXPECT_LT(*m.repeatability_rsd_percent, 0.6);  // the paper's figure
  EXPECT_GT(m.budget->repeat_m3, 0);
  const double truth_m3 = GrainFloor_m2(BoxBin()) * 0.1;
  EXPECT_NEAR(*m.volume_m3, truth_m3, *m.volume_u95_m3);
}

TEST(RunShots, OneShotHasNoScatter) {
  const Measurement m = Measure(WithReference(), LevelGrain(0.1));
  EXPECT_FALSE(m.repeatability_rsd_percent);
  EXPECT_EQ(m.budget->repeat_m3, 0);
}

TEST(RunShots, WhatMovesBetweenTheShotsIsRefusedWithItsPlace) {
  const Measurement m =
      WithReference().RunShots({{WithVisitor(0.1, 150, 1)}, {WithVisitor(0.1, 220, 2)}}, {}).measurement;
  ExpectNoFigure(m);
  EXPECT_EQ(m.reason, Reason::kSceneMoving) << m.detail;
  EXPECT_THAT(m.detail, AllOf(HasSubstr("rig a"), HasSubstr("x = ")));
}

TEST(RunShots, APoorShotIsNamed) {
  const Measurement m = WithReference().RunShots({{LevelGrain(0.1)}, {Blank(0)}}, {}).measurement;
  ExpectNoFigure(m);
  EXPECT_EQ(m.reason, Reason::kTooDark);
  EXPECT_THAT(m.detail, HasSubstr("shot 2 of 2"));
}

TEST(RunShots, RefusesNoShotAtAll) {
  EXPECT_THROW(static_cast<void>(WithReference().RunShots({}, {})), std::invalid_argument);
}

TEST(Run, TakesTheConfiguredReliefOff) {
  RigSetup rig = Rig();
  rig.reference = SomeReference();
  PipelineOptions options;
  options.surface.reduced_coverage = 0.75;
  Bin bin = BoxBin();
  const double before_m3 = *Pipeline(bin, {rig}, options).Run({LevelGrain(0.1)}, {}).measurement.volume_m3;
  bin.grain.surface_offset_m = 0.001;
  const Measurement m = Pipeline(bin, {rig}, options).Run({LevelGrain(0.1)}, {}).measurement;
  EXPECT_NEAR(before_m3 - *m.volume_m3, 0.001 * GrainFloor_m2(bin), 1e-9);  // all of the floor is covered
  EXPECT_NEAR(m.budget->relief_m3, 0.00025 * GrainFloor_m2(bin), 1e-9);
}

TEST(Run, RefusesAnotherNumberOfPairs) {
  const Pipeline pipeline = Empty();
  EXPECT_THROW(static_cast<void>(pipeline.Run({}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(pipeline.Run({Blank(0), Blank(0)}, {})), std::invalid_argument);
}

TEST(Run, BlackFramesAreTooDarkAndGiveNoFigure) {
  const Measurement m = Measure(WithReference(), Blank(0));
  EXPECT_EQ(m.reason, Reason::kTooDark);
  ExpectNoFigure(m);
}

TEST(Run, FullFramesAreSaturated) { EXPECT_EQ(Measure(WithReference(), Blank(255)).reason, Reason::kSaturated); }

TEST(Run, LightWithoutDotsIsADarkProjector) {
  EXPECT_EQ(Measure(WithReference(), Blank(90)).reason, Reason::kProjectorDark);
}

TEST(Run, FramesOfAnotherSizeAreInvalidWithTheirSizeInTheDetail) {
  const Measurement m = Measure(WithReference(), Blank(90, CV_8UC1, {300, 240}));
  EXPECT_EQ(m.reason, Reason::kFrameInvalid);
  EXPECT_THAT(m.detail, AllOf(HasSubstr("rig a"), HasSubstr("L.png"), HasSubstr("300 x 240"), HasSubstr("320 x 240")));
  ExpectNoFigure(m);
}

TEST(Run, ColourFramesAreInvalid) {
  EXPECT_EQ(Measure(WithReference(), Blank(90, CV_8UC3)).reason, Reason::kFrameInvalid);
}

TEST(Run, ExchangedFramesAreToldApart) {
  FramePair pair = LevelGrain(0.1);
  std::swap(pair.left, pair.right);
  const Measurement m = Measure(WithReference(), pair);
  EXPECT_EQ(m.reason, Reason::kSidesSwapped);
  ExpectNoFigure(m);
}

TEST(Run, GrainAboveTheBinIsNoFigure) {
  // 6 mm over the top at 0.285 m are within the range searched
  const Measurement m = Measure(WithReference(), LevelGrain(0.31));
  EXPECT_EQ(m.reason, Reason::kAboveBin);
  ExpectNoFigure(m);
}

TEST(Run, TooLittleOfTheFloorSeenIsNoFigureButSaysHowMuch) {
  FramePair pair = LevelGrain(0.1);
  // Two thirds of the bin lie in a picture of something else.
  const FramePair other = LevelGrain(0.1, 99);
  other.right.image.colRange(0, 190).copyTo(pair.right.image.colRange(0, 190));
  const Measurement m = Measure(WithReference(), pair);
  EXPECT_EQ(m.reason, Reason::kCoverageLow) << m.detail;
  EXPECT_LT(m.coverage_percent.value_or(100), 60);
  ExpectNoFigure(m);
}

TEST(Run, AFootprintOutOfViewIsNoFigure) {
  RigSetup rig = Rig();
  rig.world_from_left.translation().x() += 0.6;
  const Measurement m = Measure(Pipeline(BoxBin(), {rig}, {}), LevelGrain(0.1));
  EXPECT_EQ(m.reason, Reason::kFootprintOutOfView);
  ExpectNoFigure(m);
}

TEST(Run, FillsTheTimingsFromTheStopwatch) {
  double now = 0;
  const Measurement m = WithReference().Run({LevelGrain(0.1)}, {}, [&] { return now += 1; }).measurement;
  EXPECT_GT(m.timings_ms.rectify, 0);
  EXPECT_GT(m.timings_ms.match, 0);
  EXPECT_GT(m.timings_ms.cloud, 0);
  EXPECT_GT(m.timings_ms.segment, 0);
  EXPECT_GT(m.timings_ms.mesh, 0);
  EXPECT_GT(m.timings_ms.volume, 0);
  EXPECT_EQ(m.timings_ms.capture, 0);
  EXPECT_EQ(Measure(WithReference(), LevelGrain(0.1)).timings_ms.total, 0);  // none without a stopwatch
}

TEST(TakeReference, SeesTheFloorAndBelongsToTheRig) {
  const auto run = Empty().TakeReference(0, LevelGrain(0));
  ASSERT_EQ(run.reason, Reason::kOk) << run.detail;
  EXPECT_GT(run.coverage_percent, 95);
  EXPECT_EQ(run.reference->rig_hash, HashOfRig(Rig().calibration, Rig().world_from_left));
  EXPECT_EQ(run.reference->hash, HashOfPoints(run.reference->points_in_world));
  EXPECT_TRUE(run.reference->simulated);
  EXPECT_THAT(run.reference->id, HasSubstr("bin3-a-"));
}

TEST(TakeReference, PoorPicturesGiveNone) {
  const auto run = Empty().TakeReference(0, Blank(0));
  EXPECT_EQ(run.reason, Reason::kTooDark);
  EXPECT_FALSE(run.reference);
}

TEST(TakeReference, RefusesARigThatDoesNotExist) {
  EXPECT_THROW(static_cast<void>(Empty().TakeReference(1, Blank(0))), std::out_of_range);
}

TEST(HashOfRig, ChangesWithEveryPart) {
  const RigSetup rig = Rig();
  const std::string before = HashOfRig(rig.calibration, rig.world_from_left);
  EXPECT_EQ(before.size(), 16U);
  RigSetup other = Rig();
  other.calibration.D2[1] = 1e-9;
  EXPECT_NE(HashOfRig(other.calibration, other.world_from_left), before);
  other = Rig();
  other.calibration.T_m[1] = 1e-9;
  EXPECT_NE(HashOfRig(other.calibration, other.world_from_left), before);
  other = Rig();
  other.world_from_left.translation().y() += 1e-9;
  EXPECT_NE(HashOfRig(other.calibration, other.world_from_left), before);
}

TEST(HashOfPoints, ChangesWithOneBitWhateverTheLayout) {
  cv::Mat wide(4, 8, CV_32FC3, cv::Scalar::all(0.5));
  const std::string before = HashOfPoints(wide.colRange(0, 5));
  EXPECT_EQ(HashOfPoints(wide.colRange(0, 5).clone()), before);
  wide.at<cv::Vec3f>(3, 4)[2] = std::nextafter(0.5f, 1.0f);
  EXPECT_NE(HashOfPoints(wide.colRange(0, 5)), before);
}

}  // namespace
}  // namespace granary
