// Aravis does not say when a camera takes another value than the one written: so each is read back.
#include "drivers/camera_aravis_features.h"

#include <arv.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <type_traits>
#include <utility>

#include "drivers/camera_aravis_glib.h"

namespace granary {
namespace {

// An integrator's value counts as taken when the camera's own grid is no coarser than this.
constexpr double kFeatureTolerance = 0.01;

std::string Written(double value) {
  std::ostringstream words;
  words.precision(10);
  words << value;
  return words.str();
}

std::string Joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : ", ") + word;
  return all.empty() ? "nothing" : all;
}

/// The camera is not there any more, rather than unwilling.
bool IsGone(const GError& error) {
  if (error.domain != ARV_DEVICE_ERROR) return false;
  switch (error.code) {
    case ARV_DEVICE_ERROR_TIMEOUT:
    case ARV_DEVICE_ERROR_NOT_CONNECTED:
    case ARV_DEVICE_ERROR_TRANSFER_ERROR:
    case ARV_DEVICE_ERROR_NOT_FOUND:
      return true;
    default:
      return false;
  }
}

Reason ReasonOf(const GError& error) {
  if (IsGone(error)) return Reason::kCameraUnavailable;
  if (error.domain == ARV_DEVICE_ERROR && error.code == ARV_DEVICE_ERROR_NOT_CONTROLLER) return Reason::kCameraInUse;
  return Reason::kSettingRefused;
}

}  // namespace

bool CameraFeatures::Has(const std::string& name) const {
  GErrorSlot error;
  const bool available = arv_device_is_feature_available(device_, name.c_str(), error.Out()) != FALSE;
  if (error && IsGone(*error.get())) Check(error, "look for " + name);
  return available && !error;
}

std::string CameraFeatures::FirstOf(const std::vector<std::string>& names) const {
  const auto found = std::find_if(names.begin(), names.end(), [this](const std::string& name) { return Has(name); });
  return found == names.end() ? "" : *found;
}

std::string CameraFeatures::Text(const std::string& name) const {
  GErrorSlot error;
  const char* text = arv_device_get_string_feature_value(device_, name.c_str(), error.Out());
  Check(error, "read " + name);
  return text == nullptr ? "" : text;
}

bool CameraFeatures::IsFloat(const std::string& name) const {
  return ARV_IS_GC_FLOAT(arv_device_get_feature(device_, name.c_str())) != FALSE;
}

double CameraFeatures::Number(const std::string& name) const {
  if (!IsFloat(name)) return static_cast<double>(Integer(name));
  GErrorSlot error;
  const double value = arv_device_get_float_feature_value(device_, name.c_str(), error.Out());
  Check(error, "read " + name);
  return value;
}

std::int64_t CameraFeatures::Integer(const std::string& name) const {
  GErrorSlot error;
  const gint64 value = arv_device_get_integer_feature_value(device_, name.c_str(), error.Out());
  Check(error, "read " + name);
  return value;
}

std::vector<std::string> CameraFeatures::Entries(const std::string& name) const {
  GErrorSlot error;
  guint count = 0;
  const GMemory<const char*> names(
      arv_device_dup_available_enumeration_feature_values_as_strings(device_, name.c_str(), &count, error.Out()));
  Check(error, "read the choices of " + name);
  return names ? std::vector<std::string>(names.get(), names.get() + count) : std::vector<std::string>{};
}

std::pair<double, double> CameraFeatures::Range(const std::string& name) const {
  GErrorSlot error;
  std::pair<double, double> range;
  if (IsFloat(name)) {
    arv_device_get_float_feature_bounds(device_, name.c_str(), &range.first, &range.second, error.Out());
  } else {
    gint64 least = 0, greatest = 0;
    arv_device_get_integer_feature_bounds(device_, name.c_str(), &least, &greatest, error.Out());
    range = {static_cast<double>(least), static_cast<double>(greatest)};
  }
  Check(error, "read the range of " + name);
  return range;
}

std::string CameraFeatures::Allowed(const std::string& name) const {
  ArvGcNode* node = arv_device_get_feature(device_, name.c_str());
  if (ARV_IS_GC_ENUMERATION(node)) return Joined(Entries(name));
  if (ARV_IS_GC_BOOLEAN(node)) return "true, false";
  if (ARV_IS_GC_COMMAND(node)) return "true, which executes it";
  if (ARV_IS_GC_STRING(node)) return "a string";
  const auto [least, greatest] = Range(name);
  const std::string range = Written(least) + " to " + Written(greatest);
  if (IsFloat(name)) return range;
  GErrorSlot error;
  const gint64 step = arv_device_get_integer_feature_increment(device_, name.c_str(), error.Out());
  return error || step <= 1 ? range : range + " in steps of " + std::to_string(step);
}

void CameraFeatures::SetNumber(const std::string& key, const std::string& name, double value, double tolerance) const {
  if (!Has(name)) Refuse(key, "the camera has no " + name);
  const std::string words = Written(value);
  const auto [least, greatest] = Range(name);
  if (!(value >= least && value <= greatest)) {
    Refuse(key, name + " cannot be " + words + ", allowed is " + Allowed(name));
  }
  GErrorSlot set_error;
  double step = 0;
  if (IsFloat(name)) {
    arv_device_set_float_feature_value(device_, name.c_str(), value, set_error.Out());
    GErrorSlot no_step;  // many cameras have none
    const double told = arv_device_get_float_feature_increment(device_, name.c_str(), no_step.Out());
    if (!no_step && std::isfinite(told) && told > 0 && told < std::abs(value)) step = told;
  } else {
    if (std::nearbyint(value) != value) Refuse(key, name + " wants a whole number, allowed is " + Allowed(name));
    arv_device_set_integer_feature_value(device_, name.c_str(), std::llround(value), set_error.Out());
  }
  CheckSet(set_error, key, name, words);
  const double read = Number(name);
  if (!(std::abs(read - value) <= std::max(step, tolerance))) {
    Refuse(key, "the camera made " + Written(read) + " of " + name + " = " + words + ", allowed is " + Allowed(name));
  }
}

void CameraFeatures::SetEntry(const std::string& key, const std::string& name, const std::string& entry) const {
  if (!Has(name)) Refuse(key, "the camera has no " + name);
  const auto entries = Entries(name);
  if (std::find(entries.begin(), entries.end(), entry) == entries.end()) {
    Refuse(key, name + " cannot be \"" + entry + "\", allowed is " + Joined(entries));
  }
  GErrorSlot error;
  arv_device_set_string_feature_value(device_, name.c_str(), entry.c_str(), error.Out());
  CheckSet(error, key, name, entry);
  const std::string read = Text(name);
  if (read != entry) {
    Refuse(key, "the camera made \"" + read + "\" of " + name + " = \"" + entry + "\", allowed is " + Joined(entries));
  }
}

void CameraFeatures::Set(const std::string& key, const Feature& feature) const {
  const auto& [name, value] = feature;
  if (!Has(name)) Refuse(key, "the camera has no " + name);
  ArvGcNode* node = arv_device_get_feature(device_, name.c_str());
  const bool* flag = std::get_if<bool>(&value);
  const std::string* text = std::get_if<std::string>(&value);
  const auto wrong_kind = [&] { Refuse(key, name + " does not take this kind of value, allowed is " + Allowed(name)); };

  if (ARV_IS_GC_COMMAND(node)) {
    if (flag == nullptr || !*flag) wrong_kind();
    Execute(name);
  } else if (ARV_IS_GC_BOOLEAN(node)) {
    if (flag == nullptr) wrong_kind();
    GErrorSlot set_error, get_error;
    arv_device_set_boolean_feature_value(device_, name.c_str(), *flag ? TRUE : FALSE, set_error.Out());
    CheckSet(set_error, key, name, *flag ? "true" : "false");
    const bool read = arv_device_get_boolean_feature_value(device_, name.c_str(), get_error.Out()) != FALSE;
    Check(get_error, "read " + name);
    if (read != *flag) Refuse(key, "the camera leaves " + name + " at " + (read ? "true" : "false"));
  } else if (ARV_IS_GC_ENUMERATION(node)) {
    if (text == nullptr) wrong_kind();
    SetEntry(key, name, *text);
  } else if (ARV_IS_GC_STRING(node)) {
    if (text == nullptr) wrong_kind();
    GErrorSlot error;
    arv_device_set_string_feature_value(device_, name.c_str(), text->c_str(), error.Out());
    CheckSet(error, key, name, *text);
    if (Text(name) != *text) Refuse(key, "the camera made \"" + Text(name) + "\" of " + name + " = \"" + *text + "\"");
  } else {
    if (flag != nullptr || text != nullptr) wrong_kind();
    const auto* whole = std::get_if<std::int64_t>(&value);
    const double number = whole != nullptr ? static_cast<double>(*whole) : std::get<double>(value);
    SetNumber(key, name, number, IsFloat(name) ? kFeatureTolerance * std::abs(number) : 0);
  }
}

void CameraFeatures::Execute(const std::string& name) const {
  GErrorSlot error;
  arv_device_execute_command(device_, name.c_str(), error.Out());
  Check(error, "execute " + name);
}

void CameraFeatures::Check(const GErrorSlot& error, const std::string& operation) const {
  if (error) Fail(ReasonOf(*error.get()), operation, error.Words());
}

void CameraFeatures::CheckSet(const GErrorSlot& error, const std::string& key, const std::string& name,
                              const std::string& value) const {
  if (!error) return;
  if (ReasonOf(*error.get()) != Reason::kSettingRefused) Check(error, "set " + name);
  Refuse(key, "the camera refuses " + name + " = " + value + " (" + error.Words() + "), allowed is " + Allowed(name));
}

void CameraFeatures::Fail(Reason reason, const std::string& operation, const std::string& words) const {
  throw DeviceError(reason, camera_, operation, words);
}

void CameraFeatures::Refuse(const std::string& key, const std::string& words) const {
  Fail(Reason::kSettingRefused, "set", key + ": " + words);
}

}  // namespace granary
