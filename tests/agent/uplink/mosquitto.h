// A real mosquitto for one test: on a free loopback port, stopped by the destructor.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/scratch.h"

namespace fxagent::test {

/// Starts a program (found through PATH) without a shell; its output goes to `log`.
pid_t spawn(const std::vector<std::string>& arguments, const std::string& log);
/// Runs a program to its end. Throws if it fails, because the test would be meaningless.
void run(const std::vector<std::string>& arguments, const std::string& log);

/// Returns a free port of 127.0.0.1, reserved for the caller until the process ends.
std::uint16_t free_port();

/// Creates a certificate authority and certificates with openssl: ca.pem, server.pem/.key for
/// `server_names` ("DNS:localhost,IP:127.0.0.1"), client.pem/.key; all file names begin with
/// `prefix`.
void make_certificates(const Scratch& directory, const std::string& prefix,
                       const std::string& server_names);

class Mosquitto final {
 public:
  /// `settings` are lines of mosquitto.conf after its listener. Returns when it is listening.
  explicit Mosquitto(const std::string& settings = "allow_anonymous true",
                     std::uint16_t port = free_port());
  ~Mosquitto() { kill(); }
  Mosquitto(const Mosquitto&) = delete;
  Mosquitto& operator=(const Mosquitto&) = delete;

  void kill();
  std::uint16_t port() const { return port_; }
  std::string url(const std::string& scheme = "mqtt", const std::string& host = "127.0.0.1") const {
    return scheme + "://" + host + ":" + std::to_string(port_);
  }

 private:
  Scratch directory_;
  std::uint16_t port_;
  pid_t pid_ = 0;
};

}  // namespace fxagent::test
