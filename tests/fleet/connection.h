// One MQTT connection over TCP: whole packets in, bytes out. One thread. Never destroyed before its
// io_context has stopped.
#pragma once

#include <asio.hpp>
#include <functional>
#include <string>

#include "tests/fleet/packets.h"

namespace fxfleet {

class Connection final {
 public:
  /// Receives what happens. None is empty. `ended`: refused or lost; never after close().
  struct Events {
    std::function<void()> opened;
    std::function<void(const Packet&)> received;
    std::function<void()> ended;
  };

  Connection(asio::io_context& io, Mqtt version, Events events)
      : socket_(io), version_(version), events_(std::move(events)) {}

  /// Begins to connect from `source`, from any of its ports.
  void open(const asio::ip::tcp::endpoint& server, const asio::ip::address_v4& source);
  /// Puts bytes that are sent when the present handler has returned.
  std::string& out();
  /// Closes the socket; unsent bytes are lost.
  void close();

 private:
  void flush();
  void read();
  void read_all();
  void end();

  asio::ip::tcp::socket socket_;
  const Mqtt version_;
  const Events events_;
  unsigned number_ = 0;  ///< of the connection; handlers of earlier ones do nothing
  std::string in_;
  std::string out_;
  bool flushes_ = false;
};

}  // namespace fxfleet
