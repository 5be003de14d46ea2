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
       Value<T>("exposure_us", &T::exposure_us, "us",
                "Exposure time. v4l2: within 1 % of a step of the node, usually 100 us; nodes without the control keep "
                "their own."),
       Value<T>(
           "gain_db", &T::gain_db, "dB",
           "Analogue gain. 0 is the least there is. v4l2, and GenICam cameras without a Gain in decibels, count in "
           "steps of their own: leave it at 0 and set those in features."),
       Choice<T>(
           "trigger", &T::trigger,
           std::vector<std::pair<std::string, TriggerMode>>{
               {"line0", TriggerMode::kLine0}, {"software", TriggerMode::kSoftware}, {"free", TriggerMode::kFree}},
           "What starts an exposure. line0: the camera's trigger input (aravis: one of another name is given as "
           "TriggerSource in features). free: the camera runs by itself, and a frame counts when its whole exposure "
           "lay "
           "in the projector's pulse. Unset: line0 with a GPIO projector, else software (aravis) or free (v4l2)."),
       Value<T>("files", &T::files, "", "replay only, and needed there: frames, used in turn, round and round.")
           .Allowed("pictures (PNG, TIFF, PGM); as many left as right")
           .OmitEmpty(),
       Value<T>(
           "pixel_format", &T::pixel_format, "",
           "aravis and v4l2: what the camera sends. Unset: the deepest grey that is sent unpacked in 8 bits (aravis) "
           "or that the node offers (v4l2).")
           .Allowed("a GenICam name (Mono8, Mono10p, Mono12Packed, …) or a V4L2 one (GREY, Y10, Y12, Y16, YUYV, MJPG)"),
       Value<T>("roi_px", &T::roi_px, "px",
                "aravis and v4l2: x, y, width, height of the part that is sent. Unset: the calibration's size from the "
                "sensor's first pixel on.")
           .OmitEmpty(),
       Value<T>("features", &T::features, "",
                "aravis and v4l2: GenICam features or V4L2 controls by their own names, set in this order after all "
                "else and read back.")
           .Allowed("{ Name = value, … }"),
       Value<T>("packet_size", &T::packet_size, "bytes", "GigE: of a stream packet. 0: the largest the link carries."),
       Value<T>("packet_delay_ns", &T::packet_delay_ns, "ns",
                "GigE: pause between packets. Unset: what leaves two cameras on one link their share."),
       Value<T>("resend", &T::resend, "", "GigE: packets that were lost are asked for again."),
       Value<T>("socket_buffer_kib", &T::socket_buffer_kib, "KiB",
                "GigE: receive buffer of the stream; net.core.rmem_max must allow it."),
       Value<T>("ptp", &T::ptp, "", "GigE: the camera's clock follows PTP; unlocked, no frame is taken.")},
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
       Value<T>("line_name", &T::line_name, "", "gpio only: the line's name, in place of its offset.")
           .Allowed("a name as gpioinfo lists it"),
       Value<T>("active_low", &T::active_low, "", "gpio only: the projector is lit while the line is low."),
       Value<T>("trigger_line", &T::trigger_line, "",
                "gpio only: a second line, which triggers the cameras settle_us after the projector's rose. -1: the "
                "projector's line does both."),
       Value<T>("trigger_line_name", &T::trigger_line_name, "", "gpio only: that line's name, in place of its offset.")
           .Allowed("a name as gpioinfo lists it"),
       Count<T>("settle_us", &T::settle, "us", "From the pulse's start to the exposure's."),
       Count<T>(
           "max_on_ms", &T::max_on, "ms",
           "The projector is never lit longer than this. With a camera that runs free it is lit as long, and a whole "
           "exposure has to fall inside: three frame intervals of a USB camera, e.g. 100 at 30 frames/s."),
       Value<T>("max_duty_percent", &T::max_duty_percent, "%",
                "gpio only: nor for a greater share of any ten seconds.")},
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
       Value<T>(
           "ambient", &T::ambient, "",
           "A second pair is taken with the projector dark, and taken off the first. Only where the cameras can be "
           "triggered without lighting the projector."),
       Value<T>("warmup_pairs", &T::warmup_pairs, "",
                "Pairs thrown away after idling, as cameras lose their first frames. Unset: 1 with aravis or v4l2 "
                "cameras, else 0."),
       Value<T>("exposure_brackets", &T::exposure_brackets, "",
                "Most shorter exposures, each a quarter of the one before, that are added while a picture saturates. "
                "Unset: 2 with aravis or v4l2 cameras whose exposure can be set, else 0."),
       InlineTable<T>("left", &T::left, CameraSection(), "The left camera.").Required(),
       InlineTable<T>("right", &T::right, CameraSection(), "The right camera.").Required(),
       InlineTable<T>("projector", &T::projector, ProjectorSection(), "The speckle projector. Unset: none."),
       Table<T>("sim", &T::sim, SimSection(), "The simulated bin. Used where the cameras say driver = \"sim\".")},
      [](const T& options) { return Faults(options); }};
  return section;
}

}  // namespace granary
