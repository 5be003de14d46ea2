// Plots are drawn by a program that may be absent, fail, or draw nothing.
#include "daemon/ctl/gnuplot.h"

#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "pipeline/frame_file.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string Refusal(const std::string& script, const std::filesystem::path& png) {
  try {
    DrawPlot(script, png);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

/// Another PATH until the end of the scope.
class PathIs {
 public:
  explicit PathIs(const std::string& path) : before_(std::getenv("PATH")) { setenv("PATH", path.c_str(), 1); }
  ~PathIs() { setenv("PATH", before_.c_str(), 1); }
  PathIs(const PathIs&) = delete;
  PathIs& operator=(const PathIs&) = delete;

 private:
  std::string before_;
};

TEST(DrawPlot, LeavesAPictureOfTheSizeAskedFor) {
  const TemporaryFolder folder;
  DrawPlot("plot [0:1] x title 'x'", folder / "line.png", {400, 300});
  EXPECT_EQ(ReadImage(folder / "line.png").size(), cv::Size(400, 300));
}

TEST(DrawPlot, TakesAQuoteInTheFilesName) {
  const TemporaryFolder folder;
  DrawPlot("plot [0:1] x", folder / "it's here.png");
  EXPECT_TRUE(std::filesystem::exists(folder / "it's here.png"));
}

TEST(DrawPlot, AFaultInTheScriptIsToldInGnuplotsOwnWords) {
  const TemporaryFolder folder;
  EXPECT_THAT(Refusal("plot nonsense of mine", folder / "a.png"),
              AllOf(HasSubstr("gnuplot failed"), HasSubstr("line")));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(DrawPlot, AFailureKeepsThePictureThatWasThere) {
  const TemporaryFolder folder;
  folder.Write("a.png", "before");
  EXPECT_NE(Refusal("plot nonsense of mine", folder / "a.png"), "");
  EXPECT_EQ(TemporaryFolder::Read(folder / "a.png"), "before");
}

TEST(DrawPlot, AScriptThatDrawsNothingIsNamed) {
  const TemporaryFolder folder;
  EXPECT_THAT(Refusal("x = 1", folder / "a.png"), HasSubstr("left no picture"));
}

TEST(DrawPlot, AFolderThatIsNotThereIsNamed) {
  const TemporaryFolder folder;
  EXPECT_THAT(Refusal("plot [0:1] x", folder / "absent/a.png"), HasSubstr("absent/a.png"));
}

TEST(DrawPlot, WithoutGnuplotThePackageIsNamed) {
  const TemporaryFolder folder;
  const PathIs path(folder.path().string());
  EXPECT_THAT(Refusal("plot [0:1] x", folder / "a.png"), AllOf(HasSubstr("not installed"), HasSubstr("gnuplot-nox")));
}

TEST(DrawPlot, AProgramThatReadsNothingAndDiesIsNamedBySignal) {
  const TemporaryFolder folder;
  chmod(folder.Write("gnuplot", "#!/bin/sh\nkill -9 $$\n").c_str(), 0755);
  const PathIs path(folder.path().string());
  EXPECT_THAT(Refusal(std::string(200'000, '\n'), folder / "a.png"), HasSubstr("signal 9"));
}

TEST(GnuplotQuoted, DoublesTheQuote) { EXPECT_EQ(GnuplotQuoted("it's"), "'it''s'"); }

}  // namespace
}  // namespace granary
