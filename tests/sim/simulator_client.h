// Shared by the tests of the complete simulator: clients of its lines, and a running simulator.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <termios.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/sim/bytes.h"
#include "tests/sim/simulator.h"

namespace fxsim {

using nlohmann::json;
using std::chrono::duration_cast;
using std::chrono::milliseconds;

inline constexpr milliseconds kPatience{5000};

/// A descriptor whose reads have a time limit.
class Client final {
 public:
  explicit Client(int fd) : fd_(fd) { EXPECT_GE(fd_, 0); }
  ~Client() { close(); }
  Client(Client&& other) noexcept : fd_(std::exchange(other.fd_, -1)), peer_(other.peer_) {}
  Client& operator=(Client&&) = delete;

  static Client terminal(const std::string& path) {
    const int fd = ::open(path.c_str(), O_RDWR | O_NOCTTY);
    termios settings{};
    ::tcgetattr(fd, &settings);
    ::cfmakeraw(&settings);
    ::tcsetattr(fd, TCSANOW, &settings);
    return Client(fd);
  }
  static Client tcp(std::uint16_t port) {
    Client client(::socket(AF_INET, SOCK_STREAM, 0));
    EXPECT_TRUE(client.connect_to(port));
    return client;
  }
  /// Sends to `port` and accepts datagrams from any sender; `own` 0: bound to any free port.
  static Client udp(std::uint16_t port, std::uint16_t own = 0) {
    Client client(::socket(AF_INET, SOCK_DGRAM, 0));
    client.peer_ = here(port);
    const auto address = here(own);
    EXPECT_EQ(::bind(client.fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    return client;
  }
  /// The same socket with another destination.
  static Client udp_of(const Client& other, std::uint16_t port) {
    Client client(::dup(other.fd_));
    client.peer_ = here(port);
    return client;
  }
  static bool tcp_opens(std::uint16_t port) {
    const Client client(::socket(AF_INET, SOCK_STREAM, 0));
    return client.connect_to(port);
  }
  static Client local(const std::string& path) {
    const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    return Client(fd);
  }

  void send(ByteView bytes) const {
    EXPECT_EQ(::write(fd_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  void send_datagram(ByteView bytes) const {
    EXPECT_EQ(::sendto(fd_, bytes.data(), bytes.size(), 0,
                       reinterpret_cast<const sockaddr*>(&peer_), sizeof peer_),
              static_cast<ssize_t>(bytes.size()));
  }
  struct Datagram {
    Bytes bytes;
    std::uint16_t from = 0;
  };
  /// Returns the next datagram, or an empty one after `limit`.
  Datagram datagram(milliseconds limit = kPatience) const {
    Datagram got;
    if (!wait(Clock::now() + limit)) return got;
    got.bytes.resize(4096);
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const auto count = ::recvfrom(fd_, got.bytes.data(), got.bytes.size(), 0,
                                  reinterpret_cast<sockaddr*>(&from), &size);
    got.bytes.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
    got.from = ntohs(from.sin_port);
    return got;
  }
  std::uint16_t own_port() const {
    sockaddr_in address{};
    socklen_t size = sizeof address;
    ::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
    return ntohs(address.sin_port);
  }
  /// Reads until `size` bytes have arrived, the connection ends or the time is up.
  Bytes receive(std::size_t size, milliseconds limit = kPatience) const {
    const auto end = Clock::now() + limit;
    Bytes all;
    while (all.size() < size && wait(end)) {
      std::array<std::uint8_t, 256> part{};
      const auto got = ::read(fd_, part.data(), std::min(part.size(), size - all.size()));
      if (got <= 0) break;
      all.insert(all.end(), part.begin(), part.begin() + got);
    }
    return all;
  }
  /// Waits for the peer to close the connection.
  bool ended() const {
    std::uint8_t byte = 0;
    return wait(Clock::now() + kPatience) && ::read(fd_, &byte, 1) <= 0;
  }
  Bytes ask(ByteView request, std::size_t size) const {
    send(request);
    return receive(size);
  }
  int fd() const { return fd_; }
  void close() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }

 private:
  static sockaddr_in here(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
  }
  bool connect_to(std::uint16_t port) const {
    const auto address = here(port);
    return ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  bool wait(TimePoint end) const {
    pollfd ready{fd_, POLLIN, 0};
    const auto left = duration_cast<milliseconds>(end - Clock::now()).count();
    return left > 0 && ::poll(&ready, 1, static_cast<int>(left)) > 0;
  }

  int fd_;
  sockaddr_in peer_{};
};

/// A simulator on its own thread, with its files in its own directory.
class Running final {
 public:
  explicit Running(json one, json two = json(), json three = json()) {
    auto plcs = json::array({std::move(one)});
    for (auto* more : {&two, &three})
      if (!more->is_null()) plcs.push_back(std::move(*more));
    std::string pattern = std::filesystem::temp_directory_path() / "fxsim_test.XXXXXX";
    directory_ = ::mkdtemp(pattern.data());
    for (auto& plc : plcs)
      if (plc.contains("pty")) plc["pty"] = path(plc["pty"]);
    Simulator::Options options;
    options.control = path("control");
    options.log = path("log");
    simulator_ = std::make_unique<Simulator>(parse_config({{"plcs", plcs}}), options);
    const auto ready = json::parse(simulator_->ready_line());
    EXPECT_EQ(ready["ready"], true);
    for (const auto& plc : ready["plcs"])
      for (const auto* key : {"tcp", "udp"})
        if (plc.contains(key)) ports_[plc["name"]] = plc[key];
    thread_ = std::thread([this] { simulator_->run(); });
  }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  ~Running() {
    stop();
    std::filesystem::remove_all(directory_);
  }
  void stop() {
    if (!thread_.joinable()) return;
    simulator_->stop();
    thread_.join();
  }

  std::string path(const std::string& name) const { return directory_ / name; }
  std::uint16_t port(const std::string& name) const { return ports_.at(name); }
  Client terminal() const { return Client::terminal(path("p1")); }
  Client tcp() const { return Client::tcp(port("p1")); }

  json control(const json& request) const {
    const auto client = Client::local(path("control"));
    const auto line = request.dump() + "\n";
    client.send({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()});
    std::string reply;
    while (reply.empty() || reply.back() != '\n') {
      const auto byte = client.receive(1);
      if (byte.empty()) break;
      reply += static_cast<char>(byte[0]);
    }
    return json::parse(reply);
  }

 private:
  std::filesystem::path directory_;
  std::unique_ptr<Simulator> simulator_;
  std::map<std::string, std::uint16_t> ports_;
  std::thread thread_;
};

inline json serial(json extra = json::object()) {
  json plc = {{"name", "p1"}, {"pty", "p1"}, {"baud", 0}, {"turnaround_ms", 0}};
  plc.update(extra);
  return plc;
}
inline json network(json extra = json::object()) {
  json plc = {{"name", "p1"}, {"tcp", 0}, {"baud", 0}, {"turnaround_ms", 0}};
  plc.update(extra);
  return plc;
}

}  // namespace fxsim
