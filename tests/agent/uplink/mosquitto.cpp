#include "tests/agent/uplink/mosquitto.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <stdexcept>
#include <thread>

extern char** environ;

namespace fxagent::test {
namespace {

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

bool is_listening(std::uint16_t port) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = loopback(port);
  const bool open = connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  close(fd);
  return open;
}

}  // namespace

pid_t spawn(const std::vector<std::string>& arguments, const std::string& log) {
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(),
                                   O_WRONLY | O_CREAT | O_APPEND, 0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t pid = 0;
  const int error = posix_spawnp(&pid, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::runtime_error("cannot start " + arguments.front());
  return pid;
}

void run(const std::vector<std::string>& arguments, const std::string& log) {
  int status = 0;
  waitpid(spawn(arguments, log), &status, 0);
  if (status != 0) throw std::runtime_error(arguments.front() + " failed:\n" + content_of(log));
}

std::uint16_t free_port() {
  // The socket is bound, never listens, and stays open until the end of the process. The system
  // therefore gives the port to no other process, yet a server that sets SO_REUSEADDR, as mosquitto
  // does, can listen on it.
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  const bool bound = setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
                     bind(fd, reinterpret_cast<const sockaddr*>(&address), size) == 0 &&
                     getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0;
  if (!bound) throw std::runtime_error("no free port");
  return ntohs(address.sin_port);
}

void make_certificates(const Scratch& directory, const std::string& prefix,
                       const std::string& server_names) {
  const std::string log = directory.path("openssl.log");
  const auto file = [&](const std::string& name) { return directory.path(prefix + name); };
  run({"openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
       "-days", "2", "-subj", "/CN=" + prefix + "test ca", "-keyout", file("ca.key"), "-out",
       file("ca.pem")},
      log);
  for (const std::string who : {"server", "client"}) {
    run({"openssl", "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
         "-subj", "/CN=" + who, "-keyout", file(who + ".key"), "-out", file(who + ".csr")},
        log);
    const std::string extensions =
        directory.write(prefix + who + ".ext", "subjectAltName=" + server_names + "\n");
    run({"openssl", "x509", "-req", "-in", file(who + ".csr"), "-CA", file("ca.pem"), "-CAkey",
         file("ca.key"), "-CAcreateserial", "-days", "2", "-extfile", extensions, "-out",
         file(who + ".pem")},
        log);
  }
}

Mosquitto::Mosquitto(const std::string& settings, std::uint16_t port) : port_(port) {
  // Started as root, mosquitto would switch to another user, who may not read this directory.
  const std::string config =
      directory_.write("mosquitto.conf", "user root\nlistener " + std::to_string(port) +
                                             " 127.0.0.1\n" + settings + "\n");
  const std::string log = directory_.path("mosquitto.log");
  const char* path = std::getenv("PATH");
  setenv("PATH", (std::string(path == nullptr ? "" : path) + ":/usr/sbin").c_str(), 1);
  pid_ = spawn({"mosquitto", "-c", config}, log);
  for (int i = 0; i < 1000; ++i) {
    if (is_listening(port_)) return;
    if (waitpid(pid_, nullptr, WNOHANG) == pid_) {
      pid_ = 0;
      throw std::runtime_error("mosquitto ended:\n" + content_of(log));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  kill();
  throw std::runtime_error("mosquitto does not listen:\n" + content_of(log));
}

void Mosquitto::kill() {
  if (pid_ == 0) return;
  ::kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
  pid_ = 0;
}

}  // namespace fxagent::test
