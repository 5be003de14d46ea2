// Bins that do nothing but remember what they were asked.
#pragma once

#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "daemon/control.h"

namespace granary::test {

/// Any thread. `ready = false` refuses everything.
class RecordingControl : public BinControl {
 public:
  struct Asked {
    int bin;
    BinCommand command;
    std::string who;
  };
  struct Committed {
    int bin;
    BookData book;
    std::string who;
  };
  struct Chosen {
    int bin;
    RegisterFormat format;
    std::string who;
  };

  bool Ask(int bin, BinCommand command, const std::string& who) override {
    const std::scoped_lock lock(mutex_);
    if (ready) asked_.push_back({bin, command, who});
    return ready;
  }
  bool CommitBook(int bin, const BookData& book, const std::string& who) override {
    const std::scoped_lock lock(mutex_);
    if (ready) committed_.push_back({bin, book, who});
    return ready;
  }
  bool SetFormat(int bin, const RegisterFormat& format, const std::string& who) override {
    const std::scoped_lock lock(mutex_);
    if (ready) chosen_.push_back({bin, format, who});
    return ready;
  }

  [[nodiscard]] std::vector<Asked> asked() const {
    const std::scoped_lock lock(mutex_);
    return asked_;
  }
  [[nodiscard]] std::vector<Committed> committed() const {
    const std::scoped_lock lock(mutex_);
    return committed_;
  }
  [[nodiscard]] std::vector<Chosen> chosen() const {
    const std::scoped_lock lock(mutex_);
    return chosen_;
  }

  bool ready = true;

 private:
  mutable std::mutex mutex_;
  std::vector<Asked> asked_;
  std::vector<Committed> committed_;
  std::vector<Chosen> chosen_;
};

}  // namespace granary::test
