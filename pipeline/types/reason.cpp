#include "pipeline/types/reason.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace granary {

const std::array<ReasonInfo, 25>& ReasonTable() {
  static constexpr std::array<ReasonInfo, 25> kTable{{
      {Reason::kOk, "ok", FaultKind::kNone, "Measured.", ""},
      {Reason::kNotMeasured, "not_measured", FaultKind::kNone, "No measurement has been made yet.",
       "Wait for the schedule or start a measurement."},
      {Reason::kCameraUnavailable, "camera_unavailable", FaultKind::kCamera, "A camera could not be opened.",
       "Check power, cable and the camera's id in the configuration."},
      {Reason::kFrameMissing, "frame_missing", FaultKind::kCamera, "A camera gave no frame in time.",
       "Check the trigger line, the cable and the exposure time."},
      {Reason::kSkewTooLarge, "skew_too_large", FaultKind::kCamera,
       "The two exposures started further apart than max_skew_us.",
       "Trigger both cameras from one line; check max_skew_us."},
      {Reason::kFrameInvalid, "frame_invalid", FaultKind::kCamera,
       "A frame has the wrong size, depth or number of channels.",
       "Use single-channel 8- to 16-bit frames of the calibrated size, both alike."},
      {Reason::kSettingRefused, "setting_refused", FaultKind::kCamera,
       "A camera does not take a setting of the configuration.", "Mend the key that the log names."},
      {Reason::kCameraInUse, "camera_in_use", FaultKind::kCamera, "Another program holds a camera.",
       "Close the other program; after a crash its hold ends by itself within seconds."},
      {Reason::kStrayTrigger, "stray_trigger", FaultKind::kCamera,
       "A camera took frames that no pulse of ours had asked for.",
       "Check the trigger line for noise, its pull-down, and what else drives it."},
      {Reason::kProjectorFault, "projector_fault", FaultKind::kProjector, "The projector could not be pulsed.",
       "Check the GPIO chip, line and permissions."},
      {Reason::kProjectorDark, "projector_dark", FaultKind::kProjector, "The speckle is not in the picture.",
       "Check the projector's supply, its trigger line and its window."},
      {Reason::kProjectorGuard, "projector_guard", FaultKind::kProjector,
       "The guard switched the projector off, or refused to light it so soon again.",
       "Check max_on_ms and max_duty_percent against exposure and schedule."},
      {Reason::kTooDark, "too_dark", FaultKind::kPicture, "A picture is too dark to be measured.",
       "Open the aperture or lengthen the exposure; check for a closed lens cap."},
      {Reason::kSaturated, "saturated", FaultKind::kPicture, "Too much of a picture is saturated.",
       "Shorten the exposure or keep sunlight out."},
      {Reason::kLowContrast, "low_contrast", FaultKind::kPicture, "The speckle is too faint to be matched.",
       "Clean the windows, focus the lenses, look for dust in the air."},
      {Reason::kSidesSwapped, "sides_swapped", FaultKind::kPreparation, "Left and right pictures are exchanged.",
       "Exchange the two cameras' ids (or files)."},
      {Reason::kCoverageLow, "coverage_low", FaultKind::kPicture, "Too little of the floor could be measured.",
       "Look at the pictures: something hides the grain, or the light is poor."},
      {Reason::kAboveBin, "above_bin", FaultKind::kPicture, "The surface lies above the top of the bin.",
       "Check height_m, the pose, and what stands in the view."},
      {Reason::kImplausibleChange, "implausible_change", FaultKind::kPicture,
       "The volume changed faster than the bin can be filled or emptied.",
       "Check what stands in the view; raise max_rate_m3_h if the rate is real."},
      {Reason::kFootprintOutOfView, "footprint_out_of_view", FaultKind::kPreparation,
       "Too much of the footprint lies outside both pictures.", "Check footprint_m and the pose."},
      {Reason::kSceneMoving, "scene_moving", FaultKind::kPicture,
       "Something moved in the bin between the shots of one measurement.",
       "Keep people out and the conveyors still while it measures."},
      {Reason::kCalibrationInvalid, "calibration_invalid", FaultKind::kPreparation,
       "The calibration or the pose cannot be used.", "Calibrate again; check stereo.yml and world.yml."},
      {Reason::kReferenceMissing, "reference_missing", FaultKind::kPreparation,
       "No reference of the empty bin is stored.", "Run granaryctl reference on the empty bin."},
      {Reason::kReferenceMismatch, "reference_mismatch", FaultKind::kPreparation,
       "The stored reference belongs to another calibration, pose or resolution.",
       "Run granaryctl reference again on the empty bin."},
      {Reason::kInternal, "internal", FaultKind::kInternal, "The program failed in a way it did not foresee.",
       "Send the log of this cycle to the makers."},
  }};
  return kTable;
}

const ReasonInfo& InfoOf(Reason reason) {
  const auto& table = ReasonTable();
  const auto row = std::find_if(table.begin(), table.end(), [&](const auto& info) { return info.reason == reason; });
  if (row == table.end()) {
    throw std::logic_error("reason code " + std::to_string(static_cast<int>(reason)) + " is not in the table");
  }
  return *row;
}

}  // namespace granary
