// Reading is whole-file; writing goes to a temporary name beside the target and is renamed over it once it is on the
// disk. Devices and pipes (/dev/stdout) are written straight into: a rename would replace the device itself.
#include "pipeline/file_bytes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>
#include <system_error>

#include "pipeline/file_error.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

std::string SystemWords(int error) { return std::generic_category().message(error); }

/// An open file descriptor, closed on every path.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return fd_; }
  /// Closes now; 0 or the errno (a full disk may first be noticed here).
  [[nodiscard]] int Close() {
    const int result = ::close(fd_) == 0 ? 0 : errno;
    fd_ = -1;
    return result;
  }

 private:
  int fd_;
};

void WriteAll(int fd, std::string_view bytes, const fs::path& file) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw FileError(file, "cannot be written: " + SystemWords(errno));
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void WriteInPlace(const fs::path& file, std::string_view bytes) {
  Descriptor out(::open(file.c_str(), O_WRONLY | O_CLOEXEC));
  if (out.get() < 0) throw FileError(file, "cannot be opened for writing: " + SystemWords(errno));
  WriteAll(out.get(), bytes, file);
  if (const int error = out.Close()) throw FileError(file, "cannot be written: " + SystemWords(error));
}

/// Without it the rename itself may be lost in a power cut.
void SyncFolder(const fs::path& folder, const fs::path& file) {
  const Descriptor handle(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  // Some file systems cannot sync a folder and say EINVAL; nothing is lost that could be kept there.
  if (handle.get() < 0 || (::fsync(handle.get()) != 0 && errno != EINVAL)) {
    throw FileError(file, "its folder cannot be synced to disk: " + SystemWords(errno));
  }
}

}  // namespace

std::string ReadBytes(const fs::path& file) {
  const Descriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (in.get() < 0) throw FileError(file, "cannot be opened: " + SystemWords(errno));
  struct stat info {};
  if (::fstat(in.get(), &info) != 0) throw FileError(file, "cannot be read: " + SystemWords(errno));
  if (!S_ISREG(info.st_mode)) throw FileError(file, "is no plain file");
  if (info.st_size == 0) throw FileError(file, "is empty (0 bytes)");
  std::string bytes(static_cast<std::size_t>(info.st_size), '\0');
  std::size_t filled = 0;
  while (filled < bytes.size()) {
    const ssize_t got = ::read(in.get(), bytes.data() + filled, bytes.size() - filled);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw FileError(file, "cannot be read: " + SystemWords(errno));
    if (got == 0) throw FileError(file, "shrank while it was read; it must not be written at the same time");
    filled += static_cast<std::size_t>(got);
  }
  return bytes;
}

void WriteBytes(const fs::path& file, std::string_view bytes) {
  std::error_code ignored;
  if (file.filename().empty()) throw FileError(file, "is no file name");
  const fs::file_status status = fs::status(file, ignored);
  if (fs::is_directory(status)) throw FileError(file, "is a folder; a file name is wanted");
  if (fs::exists(status) && !fs::is_regular_file(status)) return WriteInPlace(file, bytes);

  // Through a link the file it names is replaced, not the link.
  fs::path target = fs::is_symlink(fs::symlink_status(file, ignored)) ? fs::weakly_canonical(file, ignored) : file;
  if (target.empty()) target = file;
  const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
  if (!fs::is_directory(folder, ignored))
    throw FileError(file, "cannot be written: there is no folder " + folder.string());

  static std::atomic<unsigned> serial{0};
  std::string name = ".";
  name += target.filename().string() + ".tmp" + std::to_string(::getpid()) + "-" + std::to_string(serial.fetch_add(1));
  const fs::path temporary = folder / name;
  Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (out.get() < 0) throw FileError(file, "cannot be created: " + SystemWords(errno));
  try {
    WriteAll(out.get(), bytes, file);
    if (::fsync(out.get()) != 0) throw FileError(file, "cannot be written to disk: " + SystemWords(errno));
    if (const int error = out.Close()) throw FileError(file, "cannot be written: " + SystemWords(error));
    if (::rename(temporary.c_str(), target.c_str()) != 0) {
      throw FileError(file, "cannot be put in place: " + SystemWords(errno));
    }
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
  SyncFolder(folder, file);
}

void MakeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw FileError(folder, "the folder cannot be made: " + error.message());
}

}  // namespace granary
