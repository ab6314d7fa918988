#include "tests/fleet/connection.h"

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <stdexcept>

namespace fxfleet {

void Connection::open(const asio::ip::tcp::endpoint& server, const asio::ip::address_v4& source) {
  close();
  asio::error_code error;
  socket_.open(asio::ip::tcp::v4(), error);
  if (error) throw std::runtime_error("no socket: " + error.message());
  socket_.non_blocking(true);
  socket_.set_option(asio::ip::tcp::no_delay(true));
  if (server.address().is_loopback()) {
    // The port is chosen when the server is known, so that each source address has all ports.
    const int on = 1;
    setsockopt(socket_.native_handle(), IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, &on, sizeof on);
    socket_.bind({source, 0});
  }
  const unsigned number = number_;
  socket_.async_connect(server, [this, number](asio::error_code failed) {
    if (number != number_) return;
    if (failed) return end();
    events_.opened();
    read();
  });
}

std::string& Connection::out() {
  if (!flushes_) {
    flushes_ = true;
    asio::post(socket_.get_executor(), [this, number = number_] {
      if (number == number_) flush();
    });
  }
  return out_;
}

void Connection::close() {
  ++number_;
  asio::error_code ignored;
  socket_.close(ignored);
  in_.clear();
  out_.clear();
  flushes_ = false;
}

void Connection::flush() {
  asio::error_code error;
  const std::size_t sent = socket_.write_some(asio::buffer(out_), error);
  if (error && error != asio::error::would_block) return;  // the read reports it
  out_.erase(0, sent);
  flushes_ = !out_.empty();
  if (!flushes_) {
    if (out_.capacity() > 4096) out_.shrink_to_fit();
    return;
  }
  socket_.async_wait(asio::socket_base::wait_write, [this, number = number_](asio::error_code) {
    if (number == number_) flush();
  });
}

void Connection::read() {
  socket_.async_wait(asio::socket_base::wait_read, [this, number = number_](asio::error_code) {
    if (number == number_) read_all();
  });
}

void Connection::read_all() {
  static std::array<char, 65536> buffer;  // of the one thread
  asio::error_code error;
  const std::size_t count = socket_.read_some(asio::buffer(buffer), error);
  if (error && error != asio::error::would_block) return end();
  std::string_view bytes(buffer.data(), count);
  std::string whole;
  if (!in_.empty()) {
    whole = std::move(in_);
    whole += bytes;
    bytes = whole;
  }
  const unsigned number = number_;
  while (const auto packet = take_packet(bytes, version_)) {
    events_.received(*packet);
    if (number != number_) return;  // closed by the receiver
  }
  in_ = std::string(bytes);
  read();
}

void Connection::end() {
  close();
  events_.ended();
}

}  // namespace fxfleet
