// gnuplot reads its script from standard input and answers into a file; both are files without a name, so that neither
// a full pipe nor a program that ends early can block or kill us.
#include "daemon/ctl/gnuplot.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <system_error>

namespace granary {
namespace {

namespace fs = std::filesystem;
using File = std::unique_ptr<std::FILE, decltype([](std::FILE* file) { std::fclose(file); })>;

[[noreturn]] void Fail(const std::string& words) { throw std::runtime_error("plot: " + words); }

File NamelessFile() {
  File file(std::tmpfile());
  if (!file) Fail(std::string("no temporary file: ") + std::strerror(errno));
  return file;
}

/// Without blank lines and the caret under the fault, on one line.
std::string WordsIn(std::FILE* file) {
  std::rewind(file);
  std::string words;
  std::array<char, 1000> line{};
  while (words.size() < 2000 && std::fgets(line.data(), line.size(), file) != nullptr) {
    const std::string text(line.data());
    const auto first = text.find_first_not_of(" \t\r\n^");
    if (first == std::string::npos) continue;
    words += (words.empty() ? "" : "; ") + text.substr(first, text.find_last_not_of(" \t\r\n") - first + 1);
  }
  return words.empty() ? "it said nothing" : words;
}

class FileActions {
 public:
  FileActions() {
    if (const int error = posix_spawn_file_actions_init(&actions_)) Fail(std::strerror(error));
  }
  ~FileActions() { posix_spawn_file_actions_destroy(&actions_); }
  FileActions(const FileActions&) = delete;
  FileActions& operator=(const FileActions&) = delete;
  void Redirect(int from, int to) {
    if (const int error = posix_spawn_file_actions_adddup2(&actions_, from, to)) Fail(std::strerror(error));
  }
  [[nodiscard]] const posix_spawn_file_actions_t* Get() const { return &actions_; }

 private:
  posix_spawn_file_actions_t actions_{};
};

/// The exit status as waitpid gives it.
int RunGnuplot(std::FILE* script, std::FILE* answer) {
  FileActions actions;
  actions.Redirect(fileno(script), STDIN_FILENO);
  actions.Redirect(fileno(answer), STDOUT_FILENO);
  actions.Redirect(fileno(answer), STDERR_FILENO);
  char name[] = "gnuplot", defaults[] = "-d";  // -d: no start file
  char* const arguments[] = {name, defaults, nullptr};
  pid_t child = 0;
  const int error = posix_spawnp(&child, name, actions.Get(), nullptr, arguments, environ);
  if (error == ENOENT) Fail("gnuplot is not installed; the Debian package is gnuplot-nox");
  if (error != 0) Fail(std::string("gnuplot cannot be started: ") + std::strerror(error));
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) Fail(std::string("gnuplot cannot be waited for: ") + std::strerror(errno));
  }
  return status;
}

bool IsPng(const fs::path& file) {
  const File in(std::fopen(file.c_str(), "rb"));
  std::array<char, 8> start{};
  return in && std::fread(start.data(), 1, start.size(), in.get()) == start.size() &&
         std::memcmp(start.data(), "\x89PNG\r\n\x1a\n", start.size()) == 0;
}

}  // namespace

std::string GnuplotQuoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("''") : std::string(1, c);
  return quoted + "'";
}

void DrawPlot(const std::string& script, const fs::path& png, PlotSize size) {
  fs::path part = png;
  part += ".part";
  const File input = NamelessFile(), answer = NamelessFile();
  const std::string whole = "set encoding utf8\nset terminal pngcairo font 'DejaVu Sans,11' size " +
                            std::to_string(size.width_px) + "," + std::to_string(size.height_px) + "\nset output " +
                            GnuplotQuoted(part.string()) + "\n" + script + "\nunset output\n";
  if (std::fwrite(whole.data(), 1, whole.size(), input.get()) != whole.size() || std::fflush(input.get()) != 0) {
    Fail(std::string("the script cannot be handed over: ") + std::strerror(errno));
  }
  std::rewind(input.get());
  std::error_code ignored;
  fs::remove(part, ignored);  // else a picture left by an earlier run would pass for this one
  const int status = RunGnuplot(input.get(), answer.get());
  const auto give_up = [&](const std::string& words) {
    fs::remove(part, ignored);
    Fail(words);
  };
  if (WIFSIGNALED(status)) give_up("gnuplot was ended by signal " + std::to_string(WTERMSIG(status)));
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) give_up("gnuplot failed: " + WordsIn(answer.get()));
  if (!IsPng(part)) give_up("gnuplot left no picture in " + png.string() + ": " + WordsIn(answer.get()));
  std::error_code error;
  fs::rename(part, png, error);
  if (error) give_up(png.string() + " cannot be written: " + error.message());
}

}  // namespace granary
