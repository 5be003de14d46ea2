// The GenICam features of one camera, set and read back. Of camera_aravis*.cpp alone.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "drivers/errors.h"
#include "drivers/options.h"

struct _ArvDevice;

namespace granary {

class GErrorSlot;

/// Borrows the device. Every method asks the camera and throws DeviceError: kCameraUnavailable when it does not
/// answer, kSettingRefused naming the configuration key and what the camera allows, else. One thread.
class CameraFeatures {
 public:
  /// @param camera its name in messages
  CameraFeatures(_ArvDevice* device, std::string camera) : device_(device), camera_(std::move(camera)) {}

  /// The camera has it, now and with the settings as they are.
  [[nodiscard]] bool Has(const std::string& name) const;
  /// The first of `names` that it has; empty when none.
  [[nodiscard]] std::string FirstOf(const std::vector<std::string>& names) const;

  [[nodiscard]] std::string Text(const std::string& name) const;
  [[nodiscard]] double Number(const std::string& name) const;
  [[nodiscard]] std::int64_t Integer(const std::string& name) const;
  /// Of an enumeration, those that can be chosen now.
  [[nodiscard]] std::vector<std::string> Entries(const std::string& name) const;
  /// As a sentence's end: "10 to 10000000", "1 to 2048 in steps of 4", "Mono8, Mono16".
  [[nodiscard]] std::string Allowed(const std::string& name) const;
  /// Of a number: the least and the greatest that it can be now.
  [[nodiscard]] std::pair<double, double> Range(const std::string& name) const;

  /// Sets a number, and holds it to be set when what is read back is as near as `tolerance`, or as the camera's steps
  /// are wide.
  void SetNumber(const std::string& key, const std::string& name, double value, double tolerance = 0) const;
  void SetEntry(const std::string& key, const std::string& name, const std::string& entry) const;
  /// Whatever kind of feature it is; true executes a command.
  void Set(const std::string& key, const Feature& feature) const;
  void Execute(const std::string& name) const;

  /// Throws what went wrong in a call to Aravis, if anything did.
  void Check(const GErrorSlot& error, const std::string& operation) const;
  [[noreturn]] void Fail(Reason reason, const std::string& operation, const std::string& words) const;
  [[noreturn]] void Refuse(const std::string& key, const std::string& words) const;

 private:
  void CheckSet(const GErrorSlot& error, const std::string& key, const std::string& name,
                const std::string& value) const;
  [[nodiscard]] bool IsFloat(const std::string& name) const;

  _ArvDevice* device_;
  std::string camera_;
};

}  // namespace granary
