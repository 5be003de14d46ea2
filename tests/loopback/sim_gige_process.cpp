// Its own lines say when it is ready and when it has obeyed: nothing is waited for by the clock.
#include "tests/loopback/sim_gige_process.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <stdexcept>

namespace granary {

SimGigeProcess::SimGigeProcess(const std::vector<std::string>& arguments) {
  std::vector<char*> argv{const_cast<char*>(GRANARY_SIM_GIGE)};
  for (const auto& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  std::array<int, 2> in{}, out{};
  if (pipe2(in.data(), O_CLOEXEC) != 0 || pipe2(out.data(), O_CLOEXEC) != 0) throw std::runtime_error("pipe2 failed");
  FileDescriptor their_in(in[0]), their_out(out[1]);
  in_ = FileDescriptor(in[1]);
  out_ = FileDescriptor(out[0]);
  std::signal(SIGPIPE, SIG_IGN);  // a child that has ended is an error of Tell, not our end
  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("fork failed");
  if (pid_ == 0) {
    dup2(their_in.Get(), STDIN_FILENO);
    dup2(their_out.Get(), STDOUT_FILENO);
    dup2(their_out.Get(), STDERR_FILENO);
    execv(GRANARY_SIM_GIGE, argv.data());
    _exit(127);
  }
  their_out = FileDescriptor();  // else its end would not be the end of the pipe
  ReadUntil("right = ", 0);
  ReadUntil("\n", output_.rfind("right = "));
}

SimGigeProcess::~SimGigeProcess() {
  if (pid_ > 0) End(SIGKILL);
}

void SimGigeProcess::Tell(const std::string& line) {
  const std::string typed = line + "\n";
  const auto from = output_.size();
  if (write(in_.Get(), typed.data(), typed.size()) != static_cast<ssize_t>(typed.size())) {
    throw std::runtime_error("granary-sim-gige does not listen: " + output_);
  }
  ReadUntil("\n", from);
}

std::optional<int> SimGigeProcess::End(int signal) {
  kill(pid_, signal);
  return ExitCode();
}

std::optional<int> SimGigeProcess::ExitCode() {
  while (ReadMore()) {
  }
  int status = 0;
  if (waitpid(pid_, &status, 0) != pid_) throw std::runtime_error("granary-sim-gige is not ours");
  pid_ = -1;
  return WIFEXITED(status) ? std::optional(WEXITSTATUS(status)) : std::nullopt;
}

bool SimGigeProcess::ReadMore() {
  std::array<char, 1024> bytes{};
  const auto count = read(out_.Get(), bytes.data(), bytes.size());
  if (count <= 0) return false;
  output_.append(bytes.data(), static_cast<std::size_t>(count));
  return true;
}

void SimGigeProcess::ReadUntil(const std::string& words, std::size_t from) {
  while (output_.find(words, from) == std::string::npos && ReadMore()) {
  }
}

}  // namespace granary
