// MatchStereo given whatever its docstring and Faults(StereoOptions) allow: seeded random sizes, pictures, ranges,
// options and masks; every claim is checked on every case. And what it refuses, input by input.
#include "pipeline/stereo/match.h"

#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <opencv2/core.hpp>

#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

using testing::HasSubstr;

constexpr unsigned kCases = 300;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();

class Dice {
 public:
  explicit Dice(unsigned seed) : random_(seed) {}
  int Between(int least, int most) { return least + static_cast<int>(random_() % (most - least + 1u)); }
  bool OneIn(int n) { return Between(1, n) == 1; }
  template <typename T, std::size_t N>
  T Of(const T (&choices)[N]) {
    return choices[Between(0, static_cast<int>(N) - 1)];
  }

 private:
  std::mt19937 random_;
};

struct Case {
  cv::Mat left, right;
  DisparityRange range;
  StereoOptions options;
  UsablePixels usable;
};

std::string Describe(const Case& c) {
  const StereoOptions& o = c.options;
  std::ostringstream out;
  out << c.left.cols << " x " << c.left.rows << ", type " << c.left.type() << ", " << c.range.count << " from "
      << c.range.min_px << ", census " << o.census_width << " x " << o.census_height << ", P1 " << o.p1 << ", P2 "
      << o.p2 << (o.adaptive_p2 ? " adaptive" : "") << ", median " << o.median_px << ", left-right " << o.left_right_px
      << (o.coarse_to_fine ? ", coarse to fine" : "") << ", uniqueness " << o.uniqueness << ", blobs "
      << o.speckle_area_px << ", radius " << o.refine_radius_px << (c.usable.left.empty() ? "" : ", left mask")
      << (c.usable.right.empty() ? "" : ", right mask");
  return out.str();
}

// Few levels (2: all or nothing) make ties, which is where orders of evaluation would show.
cv::Mat Noise(cv::Size size, int levels, Dice& dice) {
  cv::Mat picture(size, CV_8UC1);
  for (auto it = picture.begin<std::uint8_t>(); it != picture.end<std::uint8_t>(); ++it) {
    *it = static_cast<std::uint8_t>(dice.Between(0, levels - 1) * 255 / (levels - 1));
  }
  return picture;
}

// What the left picture shows, `shift` columns to the left: a match without any residual.
cv::Mat Moved(const cv::Mat& left, int shift) {
  cv::Mat right(left.size(), left.type());
  for (int x = 0; x < left.cols; ++x) left.col(std::clamp(x + shift, 0, left.cols - 1)).copyTo(right.col(x));
  return right;
}

StereoPair DrawPair(cv::Size size, DisparityRange range, Dice& dice) {
  const int middle = std::clamp(range.min_px + range.count / 2, -60, 60);
  switch (dice.Between(0, 8)) {
    case 0:
      return {Noise(size, dice.Of({2, 4, 256}), dice), Noise(size, 256, dice)};
    case 1: {
      const cv::Mat left = Noise(size, dice.Of({2, 4, 256}), dice);
      return {left, Moved(left, middle)};
    }
    case 2: {
      const int grey = dice.Of({0, 255, 77});
      return {cv::Mat(size, CV_8UC1, cv::Scalar(grey)), cv::Mat(size, CV_8UC1, cv::Scalar(dice.Of({grey, 0, 255})))};
    }
    case 3: {  // stripes, which match at every period
      cv::Mat left(size, CV_8UC1);
      const int period = dice.Between(1, 9);
      for (int x = 0; x < size.width; ++x) left.col(x).setTo(x % period * 20);
      return {left, Moved(left, middle)};
    }
    case 4: {  // one bright pixel in the dark
      cv::Mat left = cv::Mat::zeros(size, CV_8UC1), right = left.clone();
      for (cv::Mat* picture : {&left, &right}) {
        const int x = dice.Between(0, size.width - 1), y = dice.Between(0, size.height - 1);
        picture->at<std::uint8_t>(y, x) = 255;
      }
      return {left, right};
    }
    default: {
      const DisparityPlane plane{middle + dice.Between(-9, 9) / 10.0, dice.Between(-5, 5) / 100.0,
                                 dice.Between(-5, 5) / 100.0};
      const double noise = dice.Of({0, 2, 6});
      StereoPair pair = RenderPlane(size, plane, noise, static_cast<unsigned>(dice.Between(0, 9999)));
      if (dice.OneIn(3)) {
        for (cv::Mat* picture : {&pair.left, &pair.right}) {
          const int x = dice.Between(0, size.width - 1), y = dice.Between(0, size.height - 1);
          const int w = dice.Between(1, 30), h = dice.Between(1, 30), grey = dice.Of({0, 255, 255});
          (*picture)(cv::Rect(x, y, w, h) & cv::Rect({}, size)).setTo(grey);
        }
      }
      return pair;
    }
  }
}

// A view into a larger picture, whose rows do not follow each other.
cv::Mat Inset(const cv::Mat& picture, Dice& dice) {
  const int margin = dice.Between(1, 7);
  cv::Mat room(picture.rows + 2 * margin, picture.cols + 2 * margin, picture.type(), cv::Scalar::all(99));
  cv::Mat inset = room(cv::Rect(margin, margin, picture.cols, picture.rows));
  picture.copyTo(inset);
  return inset;
}

cv::Mat DrawMask(cv::Size size, Dice& dice) {
  if (dice.OneIn(2)) return {};
  cv::Mat mask(size, CV_8UC1);
  const int percent = dice.Of({0, 1, 50, 99, 100});
  for (auto it = mask.begin<std::uint8_t>(); it != mask.end<std::uint8_t>(); ++it) {
    *it = static_cast<std::uint8_t>(dice.Between(1, 100) <= percent ? dice.Of({1, 255}) : 0);
  }
  return mask;
}

StereoOptions DrawOptions(Dice& dice) {
  StereoOptions o;
  o.census_width = dice.Of({3, 5, 7, 9});
  o.census_height = dice.Of({3, 5, 7});
  o.p1 = dice.OneIn(2) ? dice.Between(1, 20) : dice.Between(1, 100);
  // Four paths' sums fit bytes up to P2 = 63.
  const int p2 = dice.Of({dice.Between(2, 62), dice.Between(62, 65), dice.Between(62, 65), dice.Between(66, 1000)});
  o.p2 = std::max(o.p1 + 1, p2);
  o.adaptive_p2 = dice.OneIn(3);
  o.median_px = dice.Of({0, 3, 5});
  o.left_right_px = dice.Of({0, 1, 1, 10});
  o.uniqueness = dice.Of({0.0, 0.01, 0.3, 0.99});
  o.speckle_area_px = dice.Of({0, 0, 4, 60, 1 << 30});
  o.refine_radius_px = dice.OneIn(3) ? 0 : dice.Between(1, 15);
  o.coarse_to_fine = dice.OneIn(3);
  return o;
}

Case Draw(unsigned seed) {
  Dice dice(seed);
  Case c;
  const cv::Size size{dice.OneIn(8) ? dice.Between(1, 3) : dice.Between(1, 200),
                      dice.OneIn(8) ? dice.Between(1, 3) : dice.Between(1, 60)};
  DisparityRange& range = c.range;
  range.count = dice.Of({dice.Between(1, 8), dice.Between(62, 66), dice.Between(1, 130), dice.Between(1, 2 * 200)});
  if (dice.OneIn(25) && size.area() < 2000) range.count = dice.Between(1500, 2047);
  const int least = 2 - size.width - range.count, most = size.width - 1;  // one column of overlap
  range.min_px =
      dice.OneIn(6) ? dice.Of({least, most}) : dice.Between(std::max(least, -range.count), std::min(20, most));
  c.options = DrawOptions(dice);

  StereoPair pair = DrawPair(size, range, dice);
  const int depth = dice.Of({CV_8U, CV_16U, CV_32F});
  const double scale = depth == CV_8U    ? 1
                       : depth == CV_16U ? dice.Of({257, 257, 1})
                                         : dice.Of({1.0, 1.0, 1.0 / 255, 1e-7, 1e4, 1e20, 1e35});
  const double offset = depth == CV_32F && dice.OneIn(2) ? -100 * scale : 0;
  for (cv::Mat* picture : {&pair.left, &pair.right}) picture->convertTo(*picture, depth, scale, offset);
  c.left = Inset(pair.left, dice);
  c.right = Inset(pair.right, dice);
  c.usable = {DrawMask(size, dice), DrawMask(size, dice)};
  for (cv::Mat* mask : {&c.usable.left, &c.usable.right}) {
    if (!mask->empty()) *mask = Inset(*mask, dice);
  }
  return c;
}

StereoResult Match(const Case& c, MatchBuffers* buffers = nullptr) {
  return MatchStereo(c.left, c.right, c.range, c.options, c.usable, buffers);
}

// The same pixels in memory of their own.
Case Copied(Case c) {
  for (cv::Mat* mat : {&c.left, &c.right, &c.usable.left, &c.usable.right}) *mat = mat->clone();
  return c;
}

bool SameBits(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size() || a.type() != b.type()) return false;
  for (int y = 0; y < a.rows; ++y) {
    if (std::memcmp(a.ptr(y), b.ptr(y), a.cols * a.elemSize()) != 0) return false;
  }
  return true;
}
bool SameBits(const StereoResult& a, const StereoResult& b) {
  return SameBits(a.disparity_px, b.disparity_px) && SameBits(a.deviation_px, b.deviation_px);
}

// The first claim that a pixel breaks; empty when all hold.
std::string Broken(const Case& c, int x, int y, float d, float deviation) {
  if (d == kInfinity) return std::isnan(deviation) ? "" : "an invalid pixel has a deviation";
  if (!std::isfinite(d)) return "neither finite nor +inf";
  if (!std::isfinite(deviation) || !(deviation > 0)) return "a valid pixel has no deviation";
  const bool refined = c.options.refine_radius_px > 0;
  // A winner has an index of the range and no fraction at the range's ends; the refinement moves no pixel further than
  // 1.5 px. Rounding: half a unit in the last place of 2048.
  const double shift = refined ? 1.5 + 1.3e-4 : 0;
  if (d < c.range.min_px - shift || d > c.range.min_px + c.range.count - 1 + shift) return "outside the range";
  // A winner's partner lies in the picture to half a pixel; a median may bring the disparity of a neighbour.
  const double column = x - static_cast<double>(d), beyond = 0.5 + c.options.median_px / 2 + shift;
  if (column < -beyond || column > c.left.cols - 1 + beyond) return "the partner lies outside the picture";
  if (!c.usable.left.empty() && c.usable.left.at<std::uint8_t>(y, x) == 0) return "masked out";
  if (!c.usable.right.empty()) {
    // The mask is asked for the partner that census found; up to 1.5 px further on, one of five pixels.
    const int reach = refined ? 2 : 0, partner = x - static_cast<int>(std::lround(d));
    bool usable = false;
    for (int u = partner - reach; u <= partner + reach; ++u) {
      usable = usable || c.usable.right.at<std::uint8_t>(y, std::clamp(u, 0, c.left.cols - 1)) != 0;
    }
    if (!usable) return "the partner is masked out";
  }
  return "";
}

std::string Broken(const Case& c, const StereoResult& result) {
  for (const cv::Mat* mat : {&result.disparity_px, &result.deviation_px}) {
    if (mat->size() != c.left.size() || mat->type() != CV_32FC1) return "another size or type";
  }
  for (int y = 0; y < c.left.rows; ++y) {
    for (int x = 0; x < c.left.cols; ++x) {
      const float d = result.disparity_px.at<float>(y, x), deviation = result.deviation_px.at<float>(y, x);
      const std::string broken = Broken(c, x, y, d, deviation);
      if (broken.empty()) continue;
      std::ostringstream out;
      out << "pixel " << x << ", " << y << ", disparity " << d << ", deviation " << deviation << ": " << broken;
      return out.str();
    }
  }
  return "";
}

TEST(MatchStereo, EveryPixelIsSoundWhateverThePictures) {
  int valid = 0, seen = 0;
  for (unsigned seed = 0; seed < kCases; ++seed) {
    const Case c = Draw(seed);
    ASSERT_TRUE(Faults(c.options).empty()) << Describe(c);
    const Case before = Copied(c);
    const StereoResult result = Match(c);
    EXPECT_EQ(Broken(c, result), "") << "case " << seed << ": " << Describe(c);
    EXPECT_TRUE(SameBits(c.left, before.left) && SameBits(c.right, before.right))
        << "case " << seed << " wrote in them";
    valid += cv::countNonZero(result.disparity_px < kInfinity);
    seen += c.left.size().area();
  }
  std::printf("%d of %d pixels valid\n", valid, seen);
  EXPECT_GT(valid, seen / 20);  // or the cases would show nothing; measured: 0.17
}

TEST(MatchStereo, NeitherKeptBuffersNorThreadsNorMemoryLayoutChangeABit) {
  const tbb::global_control more(tbb::global_control::max_allowed_parallelism, 5);
  tbb::task_arena one(1), three(3), five(5);
  MatchBuffers kept;
  for (unsigned seed = 0; seed < kCases; ++seed) {
    const Case c = Draw(seed), copied = Copied(c);
    const StereoResult fresh = one.execute([&] { return Match(c); });
    const StereoResult again = (seed % 2 == 0 ? three : five).execute([&] { return Match(copied, &kept); });
    EXPECT_TRUE(SameBits(fresh, again)) << "case " << seed << ": " << Describe(c);
  }
}

// The eight paths, the median, the blobs and the masks know no up and down; only the refinement's running sums and the
// coarse search's tiles do.
TEST(MatchStereo, PicturesUpsideDownGiveTheSameUpsideDown) {
  for (unsigned seed = 0; seed < kCases; ++seed) {
    Case c = Draw(seed);
    c.options.refine_radius_px = 0;
    c.options.coarse_to_fine = false;
    const StereoResult upright = Match(c);
    for (cv::Mat* mat : {&c.left, &c.right, &c.usable.left, &c.usable.right}) {
      if (!mat->empty()) cv::flip(*mat, *mat, 0);
    }
    StereoResult turned = Match(c);
    cv::flip(turned.disparity_px, turned.disparity_px, 0);
    EXPECT_TRUE(SameBits(upright.disparity_px, turned.disparity_px)) << "case " << seed << ": " << Describe(c);
  }
}

TEST(MatchStereo, MirroredPicturesGiveNegatedDisparities) {
  const StereoPair pair = RenderPlane({160, 60}, {9.3, 0.04, 0.03}, 2, 1);
  cv::Mat left, right, mirrored;
  cv::flip(pair.left, left, 1);
  cv::flip(pair.right, right, 1);
  for (const int radius : {0, 6}) {
    const StereoOptions options{.refine_radius_px = radius};
    const cv::Mat disparity = MatchStereo(pair.left, pair.right, {3, 30}, options).disparity_px;
    cv::flip(MatchStereo(left, right, {-32, 30}, options).disparity_px, mirrored, 1);
    const cv::Mat both = (disparity < kInfinity) & (mirrored < kInfinity);
    EXPECT_GT(cv::countNonZero(both), 0.8 * static_cast<double>(both.total()));
    // Of equal sums the least disparity wins, so that the left-right check may differ. Measured: 40 pixels of 8936.
    EXPECT_LT(cv::countNonZero((disparity < kInfinity) != (mirrored < kInfinity)), 0.01 * cv::countNonZero(both));
    // Rounded to floats near 32. Refined, those 40 are missing from their neighbours' windows: measured up to 0.1 px.
    EXPECT_EQ(cv::countNonZero(both & (cv::abs(disparity + mirrored) > (radius == 0 ? 1e-5 : 0.2))), 0) << radius;
  }
}

TEST(MatchStereo, AResultIsNotWrittenOverByTheNextCall) {
  for (const int radius : {0, 5}) {
    Dice dice(1);
    Case c{Noise({80, 40}, 256, dice), {}, {-4, 20}, {.refine_radius_px = radius}, {}};
    c.right = Moved(c.left, 5);
    MatchBuffers kept;
    const StereoResult first = Match(c, &kept);
    const StereoResult before{first.disparity_px.clone(), first.deviation_px.clone()};
    c.right = Moved(c.left, 9);
    static_cast<void>(Match(c, &kept));
    EXPECT_TRUE(SameBits(first, before)) << "radius " << radius;
  }
}

TEST(MatchStereo, AMaskThatLeavesNothingGivesNothing) {
  const StereoPair pair = RenderPlane({80, 40}, {5.5, 0, 0}, 2, 1);
  const cv::Mat none = cv::Mat::zeros(40, 80, CV_8UC1);
  for (const UsablePixels& usable : {UsablePixels{none, {}}, UsablePixels{{}, none}}) {
    EXPECT_EQ(cv::countNonZero(MatchStereo(pair.left, pair.right, {0, 16}, {}, usable).disparity_px < kInfinity), 0);
  }
}

/// The words of the std::invalid_argument that matching throws; a failure when it throws none.
std::string Refusal(const Case& c) {
  try {
    static_cast<void>(Match(c));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted: " << Describe(c);
  return "";
}

Case Plain(int type = CV_8UC1, cv::Size size = {30, 20}) {
  return {cv::Mat(size, type, cv::Scalar::all(1)), cv::Mat(size, type, cv::Scalar::all(1)), {0, 8}, {}, {}};
}

TEST(MatchStereo, RefusesPicturesOfDifferentSize) {
  for (const cv::Size size : {cv::Size(29, 20), cv::Size(30, 21), cv::Size(20, 30)}) {
    Case c = Plain();
    c.right = Plain(CV_8UC1, size).right;
    EXPECT_THAT(Refusal(c), HasSubstr("differ in size"));
  }
}

TEST(MatchStereo, RefusesPicturesOfDifferentDepth) {
  Case c = Plain();
  c.right = Plain(CV_16UC1).right;
  EXPECT_THAT(Refusal(c), HasSubstr("differ in depth"));
}

TEST(MatchStereo, RefusesOtherDepthsAndChannels) {
  for (const int type : {CV_8SC1, CV_16SC1, CV_32SC1, CV_64FC1, CV_8UC2, CV_8UC3, CV_16UC3, CV_32FC4}) {
    EXPECT_THAT(Refusal(Plain(type)), HasSubstr("one channel of 8 or 16 bits, or float")) << type;
  }
}

TEST(MatchStereo, RefusesEmptyPictures) {
  Case c = Plain();
  c.left = c.right = cv::Mat();
  EXPECT_THAT(Refusal(c), HasSubstr("empty"));
  c = Plain();
  c.right = cv::Mat();
  EXPECT_THAT(Refusal(c), HasSubstr("differ in size"));
}

TEST(MatchStereo, RefusesGreyLevelsThatAreNoNumbers) {
  for (const float value : {kNan, kInfinity, -kInfinity}) {
    for (const bool is_left : {true, false}) {
      Case c = Plain(CV_32FC1);
      (is_left ? c.left : c.right).at<float>(19, 29) = value;
      EXPECT_THAT(Refusal(c),
                  HasSubstr(std::string("the ") + (is_left ? "left" : "right") + " picture must be finite"));
    }
  }
}

TEST(MatchStereo, RefusesRangesWithoutOverlap) {
  for (const DisparityRange range : {DisparityRange{30, 8}, {-37, 8}, {-30, 1}, {INT_MAX, 2047}, {INT_MIN, 2047}}) {
    Case c = Plain();
    c.range = range;
    EXPECT_THAT(Refusal(c), HasSubstr("leave no overlap")) << range.min_px;
  }
}

TEST(MatchStereo, ServesRangesOfOneColumnOfOverlap) {
  for (const DisparityRange range : {DisparityRange{29, 8}, {-36, 8}, {-29, 1}}) {
    Case c = Plain();
    c.range = range;
    EXPECT_NO_THROW(static_cast<void>(Match(c))) << range.min_px;
  }
}

TEST(MatchStereo, RefusesNoDisparitiesAndTooMany) {
  for (const int count : {0, -1, INT_MIN, 2048, INT_MAX}) {
    for (const int blobs : {0, 60}) {
      Case c = Plain();
      c.range.count = count;
      c.options.speckle_area_px = blobs;
      EXPECT_THAT(Refusal(c), HasSubstr("1 to 2047")) << count;
    }
  }
}

TEST(MatchStereo, RefusesMasksThatDoNotFit) {
  for (const cv::Mat& mask : {cv::Mat(20, 31, CV_8UC1), cv::Mat(21, 30, CV_8UC1), cv::Mat(20, 30, CV_32FC1),
                              cv::Mat(20, 30, CV_8SC1), cv::Mat(20, 30, CV_8UC3)}) {
    for (const UsablePixels& usable : {UsablePixels{mask, {}}, UsablePixels{{}, mask}}) {
      Case c = Plain();
      c.usable = usable;
      EXPECT_THAT(Refusal(c), HasSubstr("must be CV_8UC1"));
    }
  }
}

TEST(MatchStereo, RefusesOptionsThatAreFaulty) {
  const std::array<std::function<void(StereoOptions&)>, 7> spoils = {[](StereoOptions& o) { o.census_width = 4; },
                                                                     [](StereoOptions& o) { o.census_height = 9; },
                                                                     [](StereoOptions& o) { o.p1 = 0; },
                                                                     [](StereoOptions& o) { o.p2 = o.p1; },
                                                                     [](StereoOptions& o) { o.median_px = 4; },
                                                                     [](StereoOptions& o) { o.uniqueness = kNan; },
                                                                     [](StereoOptions& o) { o.refine_radius_px = 16; }};
  for (const auto& spoil : spoils) {
    Case c = Plain();
    spoil(c.options);
    ASSERT_EQ(Faults(c.options).size(), 1u);
    EXPECT_THAT(Refusal(c), HasSubstr(Faults(c.options).front()));
  }
}

}  // namespace
}  // namespace granary
