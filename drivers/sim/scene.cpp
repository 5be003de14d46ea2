// A ray a pixel: to the first surface, and from there to the projector. What the light does is kept for each camera
// until the grain moves, so that another shot of a still bin costs its noise only.
#include "drivers/sim/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include "drivers/sim/grain.h"
#include "drivers/sim/hash.h"
#include "drivers/sim/motion.h"
#include "drivers/sim/optics.h"
#include "drivers/sim/speckle.h"

namespace granary {
namespace {

constexpr double kWallShare = 0.028;  // wall thickness as a share of the bin's size: 12 mm in the paper's box
constexpr double kDotPitch_px = 4.5;
constexpr double kGrainAlbedo = 0.6, kWallAlbedo = 0.4, kFloorAlbedo = 0.4, kGroundAlbedo = 0.2;
constexpr double kGrainMottle = 0.10;  // greatest relative change of the grain's albedo
// Light of a strong dot on white, as a share of full scale: after the lens, dots on grain peak at 70–85 % of full
// scale.
constexpr double kDotLight = 1.45;
constexpr double kDiffuseShare = 0.04;  // of the projector's light falls between the dots
// Motions turn at these shares of the bin.
constexpr double kEmptyMark = 0.05, kFullMark = 0.85;
// ... and below this share of the cameras' height, for rigs that hang inside the bin.
constexpr double kClearance = 0.65;
// Relative distance by which a shadow's caster must be nearer to the projector: rounding is 1e-12, grain 1e-3.
constexpr double kShadowGap = 1e-7;

// One camera in the scene.
struct Eye {
  Optics optics;
  Eigen::Matrix3d world_from_camera = Eigen::Matrix3d::Identity();  // rotation
  BinShell::View view;
  cv::Mat rays;
  double sensitivity = 1;
  double blur_px = 0.5;
  std::uint64_t key = 0;
};

// What reaches a camera's chip, CV_32FC1 in shares of full scale: from the room, and from the projector when it is on.
struct Light {
  cv::Mat ambient, projected;
};

Eigen::Matrix3d ToEigen(const cv::Matx33d& m) {
  return (Eigen::Matrix3d() << m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2))
      .finished();
}

}  // namespace

struct SimScene::Impl {
  Impl(const SimOptions& sim, const RigWorld& world);

  void FillTo(double volume_m3);
  [[nodiscard]] SceneHit Cast(const BinShell::View& view, const Eigen::Vector3d& direction) const;
  [[nodiscard]] bool ReachedByProjector(const Eigen::Vector3d& point) const;
  [[nodiscard]] double Albedo(const SceneHit& hit, const Eigen::Vector3d& point) const;
  [[nodiscard]] double Ambient(const SceneHit& hit, const Eigen::Vector3d& point) const;
  [[nodiscard]] double Projected(const SceneHit& hit, const Eigen::Vector3d& point) const;
  [[nodiscard]] Light LightOn(const Eye& eye) const;
  void PlaceProjector(const RigWorld& world, const Eigen::Vector3d& left, const Eigen::Vector3d& right);

  SimOptions options;
  bool empty;
  BinShell shell;
  Grain grain;
  Eigen::Vector2d middle_m, half_m;  // of the footprint's bounding box
  double full_m3 = 0;
  std::uint64_t step = 0;
  double volume_m3 = 0;
  HeightField surface;
  std::optional<SurfaceCaster> caster;  // none in an empty bin
  std::array<Eye, 2> eyes;
  std::array<std::optional<Light>, 2> light;

  Eigen::Matrix3d projector_from_world = Eigen::Matrix3d::Identity();
  BinShell::View lamp;
  double lamp_depth_m = 1;  // depth at which the dots have their nominal light
  std::optional<DotPattern> dots;
};

SimScene::Impl::Impl(const SimOptions& sim, const RigWorld& world)
    : options(sim),
      empty(world.empty_bin),
      shell(world.bin, kWallShare * std::sqrt(std::abs(Area_m2(world.bin.footprint_m)))),
      grain(world.bin, sim.shape, Hash(sim.seed, 10)) {
  const HeightField frame = GridOver(world.bin.footprint_m, 2);
  half_m = frame.cell_m.cwiseProduct(Eigen::Vector2d(frame.columns - 1, frame.rows - 1)) / 2;
  middle_m = frame.origin_m + half_m;

  const StereoCalibration& c = world.calibration;
  if (c.image_size.area() <= 0)
    throw std::invalid_argument("calibration: image_width and image_height must be above 0");
  const Eigen::Matrix3d world_from_left = world.world_from_left.linear();
  const Eigen::Matrix3d left_from_right = ToEigen(c.R).transpose();
  const Eigen::Vector3d right_in_left = -left_from_right * Eigen::Vector3d(c.T_m[0], c.T_m[1], c.T_m[2]);
  const std::array<Eigen::Vector3d, 2> centre{world.world_from_left.translation(),
                                              world.world_from_left * right_in_left};
  for (int k = 0; k < 2; ++k) {
    Eye& eye = eyes[k];
    const std::string name = k == 0 ? "left" : "right";
    eye.optics = k == 0 ? Optics{c.image_size, c.K1, c.D1} : Optics{c.image_size, c.K2, c.D2};
    eye.world_from_camera = k == 0 ? world_from_left : Eigen::Matrix3d(world_from_left * left_from_right);
    eye.view = shell.From(centre[k]);
    if (eye.view.Buried()) {
      throw std::invalid_argument("pose: the " + name +
                                  " camera stands inside a wall, a pillar or the floor; allowed is the open space");
    }
    eye.rays = RaysOfPixels(eye.optics, name);
    eye.sensitivity = k == 0 ? 1.0 : 0.93;
    eye.blur_px = k == 0 ? 0.45 : 0.52;
    eye.key = Hash(sim.seed, 20 + k);
  }
  PlaceProjector(world, centre[0], centre[1]);

  full_m3 = kFullMark * grain.Capacity_m3();
  const double lowest_m = std::min(centre[0].z(), centre[1].z());
  full_m3 = std::min(full_m3, kClearance * lowest_m / world.bin.height_m * grain.Capacity_m3());
  FillTo(sim.volume_m3);
}

void SimScene::Impl::PlaceProjector(const RigWorld& world, const Eigen::Vector3d& left, const Eigen::Vector3d& right) {
  // Between the cameras and a little above the line that joins them, looking where the left one looks.
  const Eigen::Matrix3d& axes = eyes[0].world_from_camera;
  const Eigen::Vector3d at = (left + right) / 2 - 0.3 * (right - left).norm() * axes.col(1);
  projector_from_world = axes.transpose();
  lamp = shell.From(at);
  if (lamp.Buried())
    throw std::invalid_argument("pose: the projector between the cameras stands inside something solid");

  const double level_m = 0.5 * std::min(world.bin.height_m, at.z());
  lamp_depth_m = (projector_from_world * (Eigen::Vector3d(middle_m.x(), middle_m.y(), level_m) - at)).z();
  if (!(lamp_depth_m > 0)) throw std::invalid_argument("pose: the left camera looks away from the bin");

  // The pattern covers what either camera sees, with room for the parallax of near things.
  Eigen::Vector2d reach = Eigen::Vector2d::Zero();
  for (const Eye& eye : eyes) {
    for (const int y : {0, eye.rays.rows / 2, eye.rays.rows - 1}) {
      for (const int x : {0, eye.rays.cols / 2, eye.rays.cols - 1}) {
        const auto& ray = eye.rays.at<cv::Vec2f>(y, x);
        const Eigen::Vector3d d = projector_from_world * eye.world_from_camera * Eigen::Vector3d(ray[0], ray[1], 1);
        if (d.z() > 0) reach = reach.cwiseMax(d.head<2>().cwiseAbs() / d.z());
      }
    }
  }
  const double parallax = 0.5 * (right - left).norm() / (0.3 * lamp_depth_m);
  constexpr double kWidest = 4;  // tangent of 76°: no projector throws its dots further
  reach = (reach + Eigen::Vector2d::Constant(parallax)).cwiseMin(kWidest);
  dots.emplace(kDotPitch_px / world.calibration.K1(0, 0), reach.x(), reach.y(), Hash(options.seed, 30));
}

void SimScene::Impl::FillTo(double volume) {
  volume_m3 = empty ? 0 : volume;
  surface = grain.SurfaceOf(volume_m3);
  caster.reset();
  if (volume_m3 > 0) caster.emplace(surface);
  light = {};
}

SceneHit SimScene::Impl::Cast(const BinShell::View& view, const Eigen::Vector3d& direction) const {
  bool over_floor = false;
  SceneHit hit = view.First(direction, &over_floor);
  if (!over_floor || !caster) return hit;
  const Eigen::Vector3d& origin = view.origin();
  double t_begin = 0;
  if (origin.z() > caster->MaxHeight_m()) {
    if (direction.z() >= 0) return hit;
    t_begin = (caster->MaxHeight_m() - origin.z()) / direction.z();
  }
  if (const auto grain_hit = caster->First(origin, direction, t_begin, hit.t)) {
    constexpr double kBare_m = 1e-9;  // where the surface is clipped to 0 there is no grain
    const bool bare = origin.z() + grain_hit->t * direction.z() < kBare_m;
    hit.surface = bare ? SceneSurface::kFloor : SceneSurface::kGrain;
    hit.t = grain_hit->t;
    hit.normal = Eigen::Vector3d(-grain_hit->slope.x(), -grain_hit->slope.y(), 1).normalized();
  }
  return hit;
}

bool SimScene::Impl::ReachedByProjector(const Eigen::Vector3d& point) const {
  const SceneHit first = Cast(lamp, point - lamp.origin());
  return first.surface == SceneSurface::kNothing || first.t > 1 - kShadowGap;
}

double SimScene::Impl::Albedo(const SceneHit& hit, const Eigen::Vector3d& point) const {
  switch (hit.surface) {
    case SceneSurface::kGrain:
      break;
    case SceneSurface::kFloor:
      return kFloorAlbedo;
    case SceneSurface::kGround:
      return kGroundAlbedo;
    default:
      return kWallAlbedo;
  }
  // A random value a node of the grain's own grid, bilinear in between.
  const Eigen::Vector2d at = (point.head<2>() - surface.origin_m).cwiseQuotient(surface.cell_m);
  const double fx = std::floor(at.x()), fy = std::floor(at.y()), p = at.x() - fx, q = at.y() - fy;
  const std::uint64_t key = options.seed * 0x9e3779b97f4a7c15ULL;
  const auto node = [&](int i, int j) {
    const auto column = static_cast<std::uint32_t>(static_cast<std::int32_t>(fx) + i);
    const auto row = static_cast<std::uint32_t>(static_cast<std::int32_t>(fy) + j);
    return Uniform(Hash(key ^ (static_cast<std::uint64_t>(row) << 32 | column)));
  };
  const double mottle = (1 - q) * ((1 - p) * node(0, 0) + p * node(1, 0)) + q * ((1 - p) * node(0, 1) + p * node(1, 1));
  return kGrainAlbedo * (1 + kGrainMottle * (2 * mottle - 1));
}

double SimScene::Impl::Ambient(const SceneHit& hit, const Eigen::Vector3d& point) const {
  // Lamps to one side: brighter there, and on what faces up.
  const Eigen::Vector2d at = (point.head<2>() - middle_m).cwiseQuotient(half_m);
  const double uneven = 0.85 + 0.3 * std::clamp(at.x(), -1.5, 1.5) - 0.15 * std::clamp(at.y(), -1.5, 1.5);
  return options.ambient * kDotLight * uneven * (0.45 + 0.55 * hit.normal.z());
}

double SimScene::Impl::Projected(const SceneHit& hit, const Eigen::Vector3d& point) const {
  const Eigen::Vector3d way = point - lamp.origin();
  const double cosine = -way.dot(hit.normal) / way.norm();
  if (cosine <= 0) return 0;
  const Eigen::Vector3d in_projector = projector_from_world * way;
  if (in_projector.z() <= 0) return 0;
  const double dot = dots->At(in_projector.x() / in_projector.z(), in_projector.y() / in_projector.z());
  // Between the beams of a laser, whose dots keep their size (no fall-off), and a lamp's (the square): the first power.
  // Of the depth, not the way, as such projectors send more to the sides so that a plane is evenly lit.
  const double nearer = lamp_depth_m / in_projector.z();
  const double full = kDotLight * cosine * nearer * (kDiffuseShare + (1 - kDiffuseShare) * dot);
  return ReachedByProjector(point) ? full : 0;
}

Light SimScene::Impl::LightOn(const Eye& eye) const {
  Light on{cv::Mat(eye.rays.size(), CV_32FC1), cv::Mat(eye.rays.size(), CV_32FC1)};
  const Eigen::Vector2d centre(eye.rays.cols / 2.0, eye.rays.rows / 2.0);
  tbb::parallel_for(tbb::blocked_range<int>(0, eye.rays.rows, 8), [&](const tbb::blocked_range<int>& rows) {
    for (int y = rows.begin(); y < rows.end(); ++y) {
      const auto* ray = eye.rays.ptr<cv::Vec2f>(y);
      auto* ambient = on.ambient.ptr<float>(y);
      auto* projected = on.projected.ptr<float>(y);
      for (int x = 0; x < eye.rays.cols; ++x) {
        ambient[x] = projected[x] = 0;
        const Eigen::Vector3d direction = eye.world_from_camera * Eigen::Vector3d(ray[x][0], ray[x][1], 1);
        const SceneHit hit = Cast(eye.view, direction);
        if (hit.surface == SceneSurface::kNothing) continue;
        const Eigen::Vector3d point = eye.view.origin() + hit.t * direction;
        const double vignette = 1 - 0.2 * (Eigen::Vector2d(x, y) - centre).squaredNorm() / centre.squaredNorm();
        const double seen = Albedo(hit, point) * eye.sensitivity * vignette;
        ambient[x] = static_cast<float>(seen * Ambient(hit, point));
        projected[x] = static_cast<float>(seen * Projected(hit, point));
      }
    }
  });
  for (cv::Mat* part : {&on.ambient, &on.projected}) {
    cv::GaussianBlur(*part, *part, {5, 5}, eye.blur_px, eye.blur_px, cv::BORDER_REPLICATE);
  }
  return on;
}

SimScene::SimScene(const SimOptions& options, const RigWorld& world) : impl_(std::make_unique<Impl>(options, world)) {}
SimScene::~SimScene() = default;
SimScene::SimScene(SimScene&&) noexcept = default;
SimScene& SimScene::operator=(SimScene&&) noexcept = default;

void SimScene::Advance() {
  ++impl_->step;
  if (impl_->empty || impl_->options.motion == SimMotion::kStill) return;
  const double empty_m3 = kEmptyMark * impl_->grain.Capacity_m3();
  impl_->FillTo(VolumeAt_m3(impl_->options, impl_->step, empty_m3, impl_->full_m3));
}

double SimScene::TruthVolume_m3() const { return impl_->grain.Volume_m3(impl_->surface); }

const HeightField& SimScene::Surface() const { return impl_->surface; }

double SimScene::Capacity_m3() const { return impl_->grain.Capacity_m3(); }

Frame SimScene::RenderSide(Side side, std::uint64_t shot, bool lit, const SimExposure& exposure) {
  const int k = side == Side::kLeft ? 0 : 1;
  auto& light = impl_->light[k];
  if (!light) light = impl_->LightOn(impl_->eyes[k]);
  const bool on = lit && impl_->options.projector_works;
  const cv::Mat sum = on ? cv::Mat(light->ambient + light->projected) : light->ambient;
  const SimChip chip{impl_->options.full_well_e, impl_->options.read_noise_e};
  Frame frame;
  frame.image = Expose(sum, exposure, chip, Hash(impl_->eyes[k].key, shot));
  frame.frame_id = shot;
  frame.source = k == 0 ? "sim:left" : "sim:right";
  frame.simulated = true;
  return frame;
}

FramePair SimScene::Render(std::uint64_t shot, bool lit) {
  FramePair pair;
  pair.left = RenderSide(Side::kLeft, shot, lit, {});
  pair.right = RenderSide(Side::kRight, shot, lit, {});
  return pair;
}

SeenPoint SimScene::PointSeenBy(Side side, const cv::Point2d& pixel) const {
  const Eye& eye = impl_->eyes[side == Side::kLeft ? 0 : 1];
  const Eigen::Vector2d ray = RayOf(eye.optics, pixel);
  const Eigen::Vector3d direction = eye.world_from_camera * Eigen::Vector3d(ray.x(), ray.y(), 1);
  const SceneHit hit = impl_->Cast(eye.view, direction);
  if (hit.surface == SceneSurface::kNothing) return {};
  const Eigen::Vector3d point = eye.view.origin() + hit.t * direction;
  const bool reached = impl_->ReachedByProjector(point) && (impl_->lamp.origin() - point).dot(hit.normal) > 0;
  return {hit.surface, point, reached};
}

}  // namespace granary
