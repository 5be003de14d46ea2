// The keys of a rig: a pair of cameras, its projector, and the simulated bin that may stand in for both.
#include "config/keys.h"

namespace granary {
namespace {

const Section<CameraOptions>& CameraSection() {
  using T = CameraOptions;
  static const Section<T> section{
      {Choice<T>("driver", &T::driver,
                 std::vector<std::pair<std::string, CameraDriver>>{{"aravis", CameraDriver::kAravis},
                                                                   {"v4l2", CameraDriver::kV4l2},
                                                                   {"replay", CameraDriver::kReplay},
                                                                   {"sim", CameraDriver::kSim}},
                 "How the camera is reached: GenICam (GigE, USB3) | a V4L2 device | frames from files | simulated.")
           .Required(),
       Value<T>("id", &T::id, "", "Which camera, as `granaryctl cameras` lists it. Needed by aravis and v4l2.")
           .Allowed("a serial, a device path"),
       Value<T>("exposure_us", &T::exposure_us, "us", "Exposure time."),
       Value<T>("gain_db", &T::gain_db, "dB", "Analogue gain."),
       Choice<T>(
           "trigger", &T::trigger,
           std::vector<std::pair<std::string, TriggerMode>>{
               {"line0", TriggerMode::kLine0}, {"software", TriggerMode::kSoftware}, {"free", TriggerMode::kFree}},
           "What starts an exposure. Unset: line0 with a GPIO projector, else software."),
       Value<T>("files", &T::files, "", "replay only, and needed there: frames, used in turn, round and round.")
           .Allowed("pictures (PNG, TIFF, PGM); as many left as right")
           .OmitEmpty()},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<ProjectorOptions>& ProjectorSection() {
  using T = ProjectorOptions;
  static const Section<T> section{
      {Choice<T>(
           "driver", &T::driver,
           std::vector<std::pair<std::string, ProjectorDriver>>{
               {"gpio", ProjectorDriver::kGpio}, {"sim", ProjectorDriver::kSim}, {"none", ProjectorDriver::kNone}},
           "How the projector is pulsed: a GPIO line | with the simulated cameras | not at all.")
           .Required(),
       Value<T>("chip", &T::chip, "", "gpio only, and needed there: the chip.")
           .Allowed("its device or label, e.g. /dev/gpiochip0"),
       Value<T>("line", &T::line, "", "gpio only: the line's offset on the chip."),
       Count<T>("settle_us", &T::settle, "us", "From the pulse's start to the exposure's."),
       Count<T>("max_on_ms", &T::max_on, "ms", "The projector is never lit longer than this.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<SimOptions>& SimSection() {
  using T = SimOptions;
  static const Section<T> section{
      {Choice<T>("shape", &T::shape,
                 std::vector<std::pair<std::string, SimShape>>{{"flat", SimShape::kFlat},
                                                               {"tilted_left", SimShape::kTiltedLeft},
                                                               {"tilted_right", SimShape::kTiltedRight},
                                                               {"convex", SimShape::kConvex},
                                                               {"concave", SimShape::kConcave},
                                                               {"partial", SimShape::kPartial}},
                 "The grain's surface; partial does not cover the floor."),
       Choice<T>("motion", &T::motion,
                 std::vector<std::pair<std::string, SimMotion>>{{"still", SimMotion::kStill},
                                                                {"filling", SimMotion::kFilling},
                                                                {"draining", SimMotion::kDraining},
                                                                {"cycle", SimMotion::kCycle}},
                 "What happens from one measurement to the next; cycle fills and drains in turn."),
       Value<T>("volume_m3", &T::volume_m3, "m3", "Grain at the first measurement."),
       Value<T>("volume_step_m3", &T::volume_step_m3, "m3", "Grain added or taken at each measurement."),
       Value<T>("seed", &T::seed, "", "Of grain texture, dots and noise; equal seeds give equal frames.")
           .Allowed("0 to 9223372036854775807"),
       Value<T>("full_well_e", &T::full_well_e, "electrons", "Full scale of a pixel; sets the shot noise."),
       Value<T>("read_noise_e", &T::read_noise_e, "electrons", "Read noise of a pixel."),
       Value<T>("ambient", &T::ambient, "", "Room light as a share of the projector's."),
       Value<T>("projector_works", &T::projector_works, "",
                "false: the lamp is dead, frames show ambient light only.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

}  // namespace

const Section<RigOptions>& RigSection() {
  using T = RigOptions;
  static const Section<T> section{
      {Value<T>("name", &T::name, "", "The rig's name, unique in its bin.").Allowed("any text"),
       Value<T>("calibration", &T::calibration, "", "The pair's calibration, stereo.yml.")
           .Required()
           .Allowed("an existing file; a relative path starts at the configuration's folder"),
       Value<T>("pose", &T::pose, "", "Where the left camera is, world.yml.")
           .Required()
           .Allowed("an existing file; a relative path starts at the configuration's folder"),
       Count<T>("max_skew_us", &T::max_skew, "us", "Largest time between the two frames of a pair."),
       InlineTable<T>("left", &T::left, CameraSection(), "The left camera.").Required(),
       InlineTable<T>("right", &T::right, CameraSection(), "The right camera.").Required(),
       InlineTable<T>("projector", &T::projector, ProjectorSection(), "The speckle projector. Unset: none."),
       Table<T>("sim", &T::sim, SimSection(), "The simulated bin. Used where the cameras say driver = \"sim\".")},
      [](const T& options) { return Faults(options); }};
  return section;
}

}  // namespace granary
