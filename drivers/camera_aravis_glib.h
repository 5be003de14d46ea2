// Owners of what Aravis hands out. Of camera_aravis*.cpp alone.
#pragma once

#include <memory>
#include <string>

#include <glib-object.h>

namespace granary {

struct UnrefGObject {
  void operator()(gpointer object) const { g_object_unref(object); }
};
/// One reference, given back at the end.
template <typename T>
using GOwner = std::unique_ptr<T, UnrefGObject>;

struct FreeGMemory {
  void operator()(gpointer memory) const { g_free(memory); }
};
/// Memory from GLib, such as the arrays of arv_…_dup_…().
template <typename T>
using GMemory = std::unique_ptr<T, FreeGMemory>;

/// Where a call puts its error; one call each.
class GErrorSlot {
 public:
  GErrorSlot() = default;
  ~GErrorSlot() { g_clear_error(&error_); }
  GErrorSlot(const GErrorSlot&) = delete;
  GErrorSlot& operator=(const GErrorSlot&) = delete;

  [[nodiscard]] GError** Out() { return &error_; }
  explicit operator bool() const { return error_ != nullptr; }
  [[nodiscard]] const GError* get() const { return error_; }
  /// The library's own words.
  [[nodiscard]] std::string Words() const {
    return error_ == nullptr || error_->message == nullptr ? "the library does not say why" : error_->message;
  }

 private:
  GError* error_ = nullptr;
};

}  // namespace granary
