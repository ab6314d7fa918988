// A real mosquitto for one test: on a free loopback port, with files in a directory of its own,
// gone with the object.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/scratch.h"

namespace fxagent::test {

/// Starts a program (found by PATH) with no shell in between; its output goes to `log`.
pid_t spawn(const std::vector<std::string>& arguments, const std::string& log);
/// Runs one to its end. Throws where it fails: without it the test means nothing.
void run(const std::vector<std::string>& arguments, const std::string& log);

/// A port of 127.0.0.1 that nobody listens on; the caller's until the process ends.
std::uint16_t free_port();

/// A certificate authority and what it signed, made by openssl: ca.pem, server.pem/.key for
/// `server_names` ("DNS:localhost,IP:127.0.0.1"), client.pem/.key; all names with `prefix` in
/// front.
void make_certificates(const Scratch& directory, const std::string& prefix,
                       const std::string& server_names);

class Mosquitto final {
 public:
  /// `settings` are lines of mosquitto.conf that follow its listener. Returns when it listens.
  Mosquitto(const Scratch& directory, const std::string& settings,
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
  std::uint16_t port_;
  pid_t pid_ = 0;
};

}  // namespace fxagent::test
