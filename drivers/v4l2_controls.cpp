// One way to set any control: look it up, check the value against what the driver says of it, set it, read it back.
#include "drivers/v4l2_controls.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <system_error>
#include <type_traits>

namespace granary {
namespace {

using Value = decltype(Feature::second);

constexpr double kExposureUnit_us = 100;
constexpr double kExposureTolerance = 0.01;

/// Empty where the node has no such control, or has switched it off for good.
std::optional<v4l2_query_ext_ctrl> FindControl(const V4l2Node& node, std::uint32_t id) {
  v4l2_query_ext_ctrl control{};
  control.id = id;
  const int error = node.Try(VIDIOC_QUERY_EXT_CTRL, &control);
  if (error == EINVAL || error == ENOTTY) return std::nullopt;
  if (error != 0) throw node.ErrorOf(error, "ask for a control");
  if ((control.flags & V4L2_CTRL_FLAG_DISABLED) != 0) return std::nullopt;
  return control;
}

std::vector<v4l2_query_ext_ctrl> ListControls(const V4l2Node& node) {
  std::vector<v4l2_query_ext_ctrl> controls;
  std::uint32_t last = 0;
  for (;;) {
    v4l2_query_ext_ctrl control{};
    control.id = last | V4L2_CTRL_FLAG_NEXT_CTRL;
    const int error = node.Try(VIDIOC_QUERY_EXT_CTRL, &control);
    if (error == EINVAL || error == ENOTTY) return controls;
    if (error != 0) throw node.ErrorOf(error, "list the controls");
    last = control.id;
    const bool usable = control.type != V4L2_CTRL_TYPE_CTRL_CLASS && (control.flags & V4L2_CTRL_FLAG_DISABLED) == 0;
    if (usable) controls.push_back(control);
  }
}

std::string NameOf(const v4l2_query_ext_ctrl& control) { return {control.name, strnlen(control.name, 32)}; }

/// As v4l2-ctl writes it: letters and digits in lower case, one underscore for whatever is between them.
std::string PlainName(const std::string& name) {
  std::string plain;
  bool gap = false;
  for (const char c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) {
      gap = !plain.empty();
      continue;
    }
    if (gap) plain += '_';
    gap = false;
    plain += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return plain;
}

bool IsMenu(const v4l2_query_ext_ctrl& control) {
  return control.type == V4L2_CTRL_TYPE_MENU || control.type == V4L2_CTRL_TYPE_INTEGER_MENU;
}

/// The entries that a menu really has, with their words.
std::vector<std::pair<std::int64_t, std::string>> MenuOf(const V4l2Node& node, const v4l2_query_ext_ctrl& control) {
  std::vector<std::pair<std::int64_t, std::string>> entries;
  for (std::int64_t index = control.minimum; index <= control.maximum; ++index) {
    v4l2_querymenu entry{};
    entry.id = control.id;
    entry.index = static_cast<__u32>(index);
    if (node.Try(VIDIOC_QUERYMENU, &entry) != 0) continue;
    // The struct is packed: its number must be copied out.
    const std::int64_t number = entry.value;
    const auto* const words = reinterpret_cast<const char*>(entry.name);
    entries.emplace_back(index, control.type == V4L2_CTRL_TYPE_MENU
                                    ? std::string(words, strnlen(words, sizeof(entry.name)))
                                    : std::to_string(number));
  }
  return entries;
}

/// What a control takes, in words.
std::string Allowed(const V4l2Node& node, const v4l2_query_ext_ctrl& control) {
  if (IsMenu(control)) {
    std::string words;
    for (const auto& [index, entry] : MenuOf(node, control)) {
      words += (words.empty() ? "" : ", ") + std::to_string(index) + " (\"" + entry + "\")";
    }
    return "must be one of " + words;
  }
  switch (control.type) {
    case V4L2_CTRL_TYPE_BOOLEAN:
      return "must be true or false";
    case V4L2_CTRL_TYPE_BUTTON:
      return "must be true: it is a button";
    case V4L2_CTRL_TYPE_STRING:
      return "must be a text of " + std::to_string(control.minimum) + " to " + std::to_string(control.maximum) +
             " characters";
    default:
      return "must be a whole number from " + std::to_string(control.minimum) + " to " +
             std::to_string(control.maximum) + (control.step > 1 ? " in steps of " + std::to_string(control.step) : "");
  }
}

std::string Words(const Value& value) {
  return std::visit(
      [](const auto& v) -> std::string {
        using T = std::decay_t<decltype(v)>;
        if constexpr (std::is_same_v<T, bool>) return v ? "true" : "false";
        if constexpr (std::is_same_v<T, std::string>) return "\"" + v + "\"";
        if constexpr (std::is_arithmetic_v<T>) return std::to_string(v);
      },
      value);
}

/// The value as a number that the control allows; empty when it is none.
std::optional<std::int64_t> NumberFor(const V4l2Node& node, const v4l2_query_ext_ctrl& control, const Value& value) {
  std::optional<std::int64_t> number;
  if (const auto* flag = std::get_if<bool>(&value)) {
    if (control.type != V4L2_CTRL_TYPE_BOOLEAN && !(control.type == V4L2_CTRL_TYPE_BUTTON && *flag)) return number;
    return *flag ? 1 : 0;
  }
  if (const auto* text = std::get_if<std::string>(&value)) {
    if (!IsMenu(control)) return number;
    for (const auto& [index, entry] : MenuOf(node, control)) {
      if (entry == *text) return index;
    }
    return number;
  }
  if (const auto* whole = std::get_if<std::int64_t>(&value)) number = *whole;
  if (const auto* real = std::get_if<double>(&value); real != nullptr && *real == std::rint(*real)) {
    if (std::abs(*real) < 1e15) number = static_cast<std::int64_t>(*real);
  }
  if (!number || control.type == V4L2_CTRL_TYPE_BUTTON || control.type == V4L2_CTRL_TYPE_STRING) return std::nullopt;
  if (control.type == V4L2_CTRL_TYPE_BITMASK) {
    // The driver's own mask stands in `maximum`.
    return (*number & ~control.maximum) == 0 ? number : std::nullopt;
  }
  if (*number < control.minimum || *number > control.maximum) return std::nullopt;
  if (IsMenu(control)) {
    const auto entries = MenuOf(node, control);
    const bool there = std::any_of(entries.begin(), entries.end(), [&](const auto& e) { return e.first == *number; });
    return there ? number : std::nullopt;
  }
  if (control.step > 1 && static_cast<std::uint64_t>(*number - control.minimum) % control.step != 0) {
    return std::nullopt;
  }
  return number;
}

int Transfer(const V4l2Node& node, unsigned long request, v4l2_ext_control& control) {
  v4l2_ext_controls one{};
  one.which = V4L2_CTRL_WHICH_CUR_VAL;
  one.count = 1;
  one.controls = &control;
  return node.Try(request, &one);
}

/// @param key as the configuration has it, for the error
void SetText(const V4l2Node& node, const v4l2_query_ext_ctrl& control, const std::string& text,
             const std::string& key) {
  std::vector<char> buffer(std::max<std::size_t>(control.elem_size, text.size() + 1), '\0');
  std::copy(text.begin(), text.end(), buffer.begin());
  v4l2_ext_control value{};
  value.id = control.id;
  value.size = static_cast<__u32>(buffer.size());
  value.string = buffer.data();
  if (const int error = Transfer(node, VIDIOC_S_EXT_CTRLS, value)) throw node.ErrorOf(error, "set " + key);
  std::fill(buffer.begin(), buffer.end(), '\0');
  if (const int error = Transfer(node, VIDIOC_G_EXT_CTRLS, value)) throw node.ErrorOf(error, "read " + key);
  const std::string got(buffer.data(), strnlen(buffer.data(), buffer.size()));
  if (got != text) throw node.Refused("set " + key, key + ": set to \"" + text + "\", reads back \"" + got + "\"");
}

/// @param key as the configuration has it, for the error
void SetNumber(const V4l2Node& node, const v4l2_query_ext_ctrl& control, std::int64_t number, const std::string& key) {
  const bool wide = control.type == V4L2_CTRL_TYPE_INTEGER64;
  v4l2_ext_control value{};
  value.id = control.id;
  if (wide) {
    value.value64 = number;
  } else {
    value.value = static_cast<__s32>(number);
  }
  if (const int error = Transfer(node, VIDIOC_S_EXT_CTRLS, value)) {
    const bool gone = node.ErrorOf(error, {}).reason() != Reason::kSettingRefused;
    if (gone) throw node.ErrorOf(error, "set " + key);
    throw node.Refused("set " + key, key + ": the driver refuses " + std::to_string(number) + " (" +
                                         std::generic_category().message(error) + "), " + Allowed(node, control));
  }
  if (control.type == V4L2_CTRL_TYPE_BUTTON || (control.flags & V4L2_CTRL_FLAG_WRITE_ONLY) != 0) return;
  value = {};
  value.id = control.id;
  if (const int error = Transfer(node, VIDIOC_G_EXT_CTRLS, value)) throw node.ErrorOf(error, "read " + key);
  // Masks of 32 bits come back with their sign.
  const std::int64_t back = wide ? std::int64_t{value.value64}
                            : control.type == V4L2_CTRL_TYPE_BITMASK
                                ? std::int64_t{static_cast<std::uint32_t>(value.value)}
                                : std::int64_t{value.value};
  if (back == number) return;
  throw node.Refused("set " + key, key + ": set to " + std::to_string(number) + ", reads back " + std::to_string(back) +
                                       "; " + Allowed(node, control));
}

/// @param key as the configuration has it, for the error
void SetControl(const V4l2Node& node, const v4l2_query_ext_ctrl& control, const Value& value, const std::string& key) {
  if ((control.flags & V4L2_CTRL_FLAG_READ_ONLY) != 0) {
    throw node.Refused("set " + key, key + ": the control can only be read");
  }
  const auto* const text = std::get_if<std::string>(&value);
  if (text != nullptr && control.type == V4L2_CTRL_TYPE_STRING) {
    SetText(node, control, *text, key);
    return;
  }
  const auto number = NumberFor(node, control, value);
  if (!number) throw node.Refused("set " + key, key + ": " + Words(value) + " is refused, " + Allowed(node, control));
  SetNumber(node, control, *number, key);
}

}  // namespace

void SwitchAutomaticsOff(const V4l2Node& node) {
  struct Automatic {
    std::uint32_t id;
    std::int64_t off;
  };
  constexpr std::array<Automatic, 9> kAutomatics{{
      {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL},
      {V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0},
      {V4L2_CID_AUTOGAIN, 0},
      {V4L2_CID_ISO_SENSITIVITY_AUTO, V4L2_ISO_SENSITIVITY_MANUAL},
      {V4L2_CID_AUTO_WHITE_BALANCE, 0},
      {V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, V4L2_WHITE_BALANCE_MANUAL},
      {V4L2_CID_FOCUS_AUTO, 0},
      {V4L2_CID_AUTOBRIGHTNESS, 0},
      {V4L2_CID_HUE_AUTO, 0},
  }};
  for (const auto& automatic : kAutomatics) {
    const auto control = FindControl(node, automatic.id);
    if (!control || (control->flags & V4L2_CTRL_FLAG_READ_ONLY) != 0) continue;
    SetNumber(node, *control, automatic.off, PlainName(NameOf(*control)));
  }
}

bool SetExposureTime(const V4l2Node& node, double exposure_us) {
  const auto control = FindControl(node, V4L2_CID_EXPOSURE_ABSOLUTE);
  if (!control || (control->flags & V4L2_CTRL_FLAG_READ_ONLY) != 0) return false;
  const auto step = std::max<double>(1, static_cast<double>(control->step));
  const auto low = static_cast<double>(control->minimum), high = static_cast<double>(control->maximum);
  const double wish = exposure_us / kExposureUnit_us;
  const double nearest = low + std::rint((wish - low) / step) * step;
  if (nearest < low || nearest > high || std::abs(nearest - wish) > kExposureTolerance * wish) {
    const auto us = [](double units) { return std::to_string(std::llround(units * kExposureUnit_us)); };
    throw node.Refused("set the exposure", "exposure_us: " + std::to_string(exposure_us) +
                                               " is refused, the driver allows " + us(low) + " to " + us(high) +
                                               " in steps of " + us(step));
  }
  SetNumber(node, *control, std::llround(nearest), "exposure_us (in units of 100 us)");
  return true;
}

std::optional<std::chrono::nanoseconds> ExposureTime(const V4l2Node& node) {
  const auto read = [&](std::uint32_t id) -> std::optional<std::int64_t> {
    if (!FindControl(node, id)) return std::nullopt;
    v4l2_ext_control value{};
    value.id = id;
    if (const int error = Transfer(node, VIDIOC_G_EXT_CTRLS, value)) throw node.ErrorOf(error, "read the exposure");
    return std::int64_t{value.value};
  };
  const auto units = read(V4L2_CID_EXPOSURE_ABSOLUTE);
  if (!units || read(V4L2_CID_EXPOSURE_AUTO).value_or(V4L2_EXPOSURE_MANUAL) != V4L2_EXPOSURE_MANUAL) {
    return std::nullopt;
  }
  return std::chrono::nanoseconds(std::llround(static_cast<double>(*units) * kExposureUnit_us * 1000));
}

void SetGain(const V4l2Node& node, double gain_db) {
  auto control = FindControl(node, V4L2_CID_GAIN);
  if (!control) control = FindControl(node, V4L2_CID_ANALOGUE_GAIN);
  if (gain_db != 0) {
    throw node.Refused("set the gain", "gain_db: must be 0 with driver = \"v4l2\", which knows no unit of gain; set " +
                                           (control ? "features = { " + PlainName(NameOf(*control)) + " = … }, which " +
                                                          Allowed(node, *control)
                                                    : "nothing: this node has no gain"));
  }
  if (!control || (control->flags & V4L2_CTRL_FLAG_READ_ONLY) != 0) return;
  SetNumber(node, *control, control->minimum, "gain_db (" + PlainName(NameOf(*control)) + ")");
}

void SetControls(const V4l2Node& node, const std::vector<Feature>& features) {
  if (features.empty()) return;
  const auto controls = ListControls(node);
  for (const auto& [name, value] : features) {
    const auto found = std::find_if(controls.begin(), controls.end(), [&](const auto& control) {
      return NameOf(control) == name || PlainName(NameOf(control)) == name;
    });
    if (found == controls.end()) {
      std::string names;
      for (const auto& control : controls) names += (names.empty() ? "" : ", ") + PlainName(NameOf(control));
      throw node.Refused("set " + name, "features." + name + ": the node has no such control; it has " +
                                            (names.empty() ? "none" : names));
    }
    SetControl(node, *found, value, "features." + name);
  }
}

}  // namespace granary
