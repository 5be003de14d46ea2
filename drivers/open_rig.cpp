// From options to devices: the one switch over drivers.
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "drivers/camera_aravis.h"
#include "drivers/camera_replay.h"
#include "drivers/camera_v4l2.h"
#include "drivers/projector_gpio.h"
#include "drivers/rig.h"
#include "drivers/sim/bench.h"
#include "drivers/sim/camera_sim.h"
#include "drivers/sim/projector_sim.h"

namespace granary {
namespace {

std::unique_ptr<Camera> OpenRealCamera(const CameraOptions& options, TriggerMode trigger, cv::Size size) {
  switch (options.driver) {
    case CameraDriver::kAravis:
      return std::make_unique<CameraAravis>(options, trigger, size);
    case CameraDriver::kV4l2:
      return std::make_unique<CameraV4l2>(options, trigger, size);
    case CameraDriver::kReplay:
      return std::make_unique<CameraReplay>(options.files);
    case CameraDriver::kSim:
      break;
  }
  throw std::logic_error("OpenRealCamera: no such driver");
}

}  // namespace

Rig OpenRig(const RigOptions& options, const RigWorld& world) {
  const bool left_sim = options.left.driver == CameraDriver::kSim;
  if (left_sim != (options.right.driver == CameraDriver::kSim)) {
    throw std::invalid_argument("left.driver, right.driver: \"sim\" is for both cameras or neither");
  }
  if (!left_sim && options.projector.driver == ProjectorDriver::kSim) {
    throw std::invalid_argument("projector.driver: \"sim\" lights simulated cameras only, allowed is \"none\"");
  }
  if (left_sim && options.projector.driver == ProjectorDriver::kGpio) {
    throw std::invalid_argument(
        "projector.driver: \"gpio\" does not light simulated cameras, allowed are \"sim\" and \"none\"");
  }

  std::unique_ptr<Camera> left, right;
  std::unique_ptr<Projector> projector;
  if (left_sim) {
    const auto bench = std::make_shared<SimBench>(options.sim, world);
    left = std::make_unique<CameraSim>(bench, Side::kLeft, options.left);
    right = std::make_unique<CameraSim>(bench, Side::kRight, options.right);
    if (options.projector.driver == ProjectorDriver::kSim) {
      projector = std::make_unique<ProjectorSim>(bench, options.projector);
    }
  } else {
    if (options.projector.driver == ProjectorDriver::kGpio) {
      projector = std::make_unique<ProjectorGpio>(options.projector);
    }
    const cv::Size size = world.calibration.image_size;
    left = OpenRealCamera(options.left, TriggerOf(options.left, options.projector), size);
    right = OpenRealCamera(options.right, TriggerOf(options.right, options.projector), size);
    auto* left_aravis = dynamic_cast<CameraAravis*>(left.get());
    auto* right_aravis = dynamic_cast<CameraAravis*>(right.get());
    if (left_aravis != nullptr && right_aravis != nullptr) CameraAravis::ShareLink(*left_aravis, *right_aravis);
  }
  return Rig(std::move(left), std::move(right), std::move(projector), CaptureOptionsOf(options));
}

}  // namespace granary
