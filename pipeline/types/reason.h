// Why a cycle gave no figure. One table: the numbers go out over Modbus (register 2), the words into logs and JSON.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace granary {

/// Reason code of a cycle; 0 means a valid measurement. The numbers are published and never change their meaning.
enum class Reason : std::uint16_t {
  kOk = 0,
  kNotMeasured = 1,
  // capture
  kCameraUnavailable = 10,
  kFrameMissing = 11,
  kSkewTooLarge = 12,
  kFrameInvalid = 13,
  kSettingRefused = 14,
  kCameraInUse = 15,
  kStrayTrigger = 16,
  kProjectorFault = 20,
  kProjectorDark = 21,
  kProjectorGuard = 22,
  // the pictures
  kTooDark = 30,
  kSaturated = 31,
  kLowContrast = 32,
  kSidesSwapped = 33,
  // the measurement
  kCoverageLow = 40,
  kAboveBin = 41,
  kImplausibleChange = 42,
  kFootprintOutOfView = 43,
  kSceneMoving = 44,
  // what was prepared
  kCalibrationInvalid = 50,
  kReferenceMissing = 51,
  kReferenceMismatch = 52,
  kInternal = 90,
};

/// Who has to look at it: decides the fault bits of the status word.
enum class FaultKind : std::uint8_t { kNone, kCamera, kProjector, kPreparation, kPicture, kInternal };

struct ReasonInfo {
  Reason reason;
  std::string_view name;  ///< as in JSON and logs, e.g. "coverage_low"
  FaultKind kind;
  std::string_view meaning;  ///< one sentence
  std::string_view remedy;   ///< what to do about it
};

/// The whole table, in ascending order of the code.
[[nodiscard]] const std::array<ReasonInfo, 25>& ReasonTable();
/// The row of `reason`. @throws std::logic_error for a code that is not in the table.
[[nodiscard]] const ReasonInfo& InfoOf(Reason reason);

}  // namespace granary
