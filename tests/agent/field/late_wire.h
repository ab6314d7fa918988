// A wire with its devices in simulated time, for answers that come late, never, twice, or to an
// agent that no longer exists. A device carries out a request when it starts on it, one after
// another. Every read returns a value that no other request ever got.
#pragma once

#include <algorithm>
#include <asio/post.hpp>
#include <asio/use_awaitable.hpp>
#include <chrono>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "agent/field/transport/transport.h"
#include "protocol/modbus/frame.h"
#include "tests/agent/field/port_frames.h"

namespace fxagent::test {

/// A request, decoded.
struct Question {
  enum class Kind : std::uint8_t { none, enquiry, read, write } kind = Kind::none;
  unsigned station = 0;
  unsigned units = 0;  ///< words; in a probe bytes or bits
  bool words = true;
  std::uint16_t transaction = 0;
  Bytes pdu;  ///< Modbus
};

/// The device's side of one protocol.
class Dialect {
 public:
  virtual ~Dialect() = default;
  virtual Question understand(ByteView frame) const = 0;
  virtual Bytes data(const Question& question, unsigned value) const = 0;
  virtual Bytes ack(const Question& question) const = 0;
  virtual Bytes nak(const Question& question) const = 0;
};

class PortDialect final : public Dialect {
 public:
  Question understand(ByteView frame) const override {
    Question out;
    if (frame.size() == 1 && frame[0] == kEnq[0]) out.kind = Question::Kind::enquiry;
    if (frame.size() < 9) return out;
    const std::string text(frame.begin() + 1, frame.end() - 3);
    const std::string rest = text.substr(text[0] == 'E' ? 3 : 1);
    out.kind =
        text[0] == '0' || text.starts_with("E00") ? Question::Kind::read : Question::Kind::write;
    out.units = static_cast<unsigned>(std::stoul(rest.substr(4, 2), nullptr, 16));
    out.words = false;
    return out;
  }
  Bytes data(const Question& question, unsigned value) const override {
    Bytes image;
    for (unsigned i = 0; i < question.units; ++i)
      image.push_back(static_cast<std::uint8_t>(value >> (8 * (i % 2))));
    return data_frame(image);
  }
  Bytes ack(const Question& /*question*/) const override { return kAck; }
  Bytes nak(const Question& /*question*/) const override { return kNak; }
};

class LinkDialect final : public Dialect {
 public:
  explicit LinkDialect(bool ends_with_cr_lf) : tail_(ends_with_cr_lf ? "\r\n" : "") {}
  Question understand(ByteView frame) const override {
    Question out;
    std::string text(frame.begin(), frame.end());
    if (text.size() < 12 || text[0] != '\x05') return out;
    text.resize(text.size() - tail_.size() - 2);
    out.station = static_cast<unsigned>(std::stoul(text.substr(1, 2), nullptr, 16));
    out.kind = text[6] == 'R' ? Question::Kind::read : Question::Kind::write;
    out.words = text[5] == 'W';
    out.units = static_cast<unsigned>(std::stoul(text.substr(text.size() - 2), nullptr, 16));
    return out;
  }
  Bytes data(const Question& question, unsigned value) const override {
    std::string body = head(question);
    for (unsigned i = 0; i < question.units; ++i)
      body += question.words ? hex_text(value, 4) : std::string("1");
    body += '\x03';
    unsigned sum = 0;
    for (const char c : body) sum += static_cast<std::uint8_t>(c);
    return bytes("\x02" + body + hex_text(sum & 0xFFU, 2));
  }
  Bytes ack(const Question& question) const override { return bytes("\x06" + head(question)); }
  Bytes nak(const Question& question) const override {
    return bytes("\x15" + head(question) + "06");
  }

 private:
  static std::string head(const Question& question) { return hex_text(question.station, 2) + "FF"; }
  Bytes bytes(const std::string& text) const {
    const std::string whole = text + tail_;
    return {whole.begin(), whole.end()};
  }
  std::string tail_;
};

class ModbusDialect final : public Dialect {
 public:
  explicit ModbusDialect(modbus::Framing framing) : framing_(framing) {}
  Question understand(ByteView frame) const override {
    modbus::Frame found;
    if (framing_ == modbus::Framing::rtu) found = modbus::rtu_frame(frame, 0, frame.size() - 3);
    if (framing_ == modbus::Framing::ascii) found = modbus::ascii_frame(frame, 0);
    if (framing_ == modbus::Framing::tcp) found = modbus::tcp_frame(frame, 0);
    Question out;
    if (found.pdu.size() < 5) return out;
    out.kind = found.pdu[0] == 3 ? Question::Kind::read : Question::Kind::write;
    out.station = found.unit;
    out.units = found.pdu[4];
    out.transaction = found.transaction;
    out.pdu = found.pdu;
    return out;
  }
  Bytes data(const Question& question, unsigned value) const override {
    Bytes pdu{3, static_cast<std::uint8_t>(2 * question.units)};
    for (unsigned i = 0; i < question.units; ++i) {
      pdu.push_back(static_cast<std::uint8_t>(value >> 8));
      pdu.push_back(static_cast<std::uint8_t>(value));
    }
    return framed(question, pdu);
  }
  Bytes ack(const Question& question) const override { return framed(question, question.pdu); }
  Bytes nak(const Question& question) const override {
    return framed(question, {static_cast<std::uint8_t>(question.pdu[0] | 0x80U), 6});
  }

 private:
  Bytes framed(const Question& question, const Bytes& pdu) const {
    return modbus::framed(framing_, static_cast<std::uint8_t>(question.station), pdu,
                          question.transaction);
  }
  modbus::Framing framing_;
};

/// The outcome of the last request.
struct Deed {
  bool written = false;  ///< a write was carried out
  bool refused = false;
  unsigned value = 0;  ///< of every word in a read
};

class LateWire final {
 public:
  using Duration = std::chrono::milliseconds;

  /// `latest`: maximum delay of each station's answer after the request.
  LateWire(const Dialect& dialect, std::map<unsigned, Duration> timeouts,
           std::map<unsigned, Duration> latest, std::uint32_t seed)
      : dialect_(dialect),
        timeouts_(std::move(timeouts)),
        latest_(std::move(latest)),
        random_(seed) {}

  SteadyTime now{std::chrono::hours(1)};
  /// The time at which the agent dies.
  SteadyTime killed_at = SteadyTime::max();
  bool keeps_what_came = false;      ///< a serial server: keeps bytes for the next client
  bool answers_end_with_it = false;  ///< TCP: drops pending answers when it is closed
  const Deed& last() const { return last_; }

  /// Receives a frame from the agent; answers only valid requests.
  void hear(ByteView frame) {
    const Question question = dialect_.understand(frame);
    if (question.kind == Question::Kind::none) return;
    last_ = {};
    if (one_in(20)) return;  // the request is lost
    last_.value = ++value_;
    last_.refused = question.kind == Question::Kind::write && one_in(6);
    last_.written = question.kind == Question::Kind::write && !last_.refused;
    if (one_in(20)) return;  // the answer is lost
    const Bytes answer = last_.refused ? dialect_.nak(question)
                         : question.kind == Question::Kind::read
                             ? dialect_.data(question, last_.value)
                             : dialect_.ack(question);
    SteadyTime& busy_until = busy_until_[question.station];
    busy_until = std::max(busy_until, now + delay(question.station));
    add(busy_until, answer);
    if (one_in(30)) add(busy_until, answer);  // a duplicate, directly after the original
    if (one_in(12)) half_of_the_last();
  }
  /// Sends an unsolicited answer of this station. Call only while no request is pending.
  void disturb(unsigned station) {
    Question nobodys;
    nobodys.station = station;
    nobodys.units = 1;
    add(now, dialect_.data(nobodys, ++value_));
  }

  /// Returns the bytes that arrive by `until`, or nothing. Advances the time to whichever comes
  /// first.
  Bytes wait(SteadyTime until) {
    const SteadyTime next = under_way_.empty() ? SteadyTime::max() : under_way_.begin()->first;
    const SteadyTime end = std::min({until, next, killed_at});
    now = std::max(now, end);
    if (under_way_.empty() || next > now || now >= killed_at) return {};
    Bytes bytes = std::move(under_way_.begin()->second);
    under_way_.erase(under_way_.begin());
    return bytes;
  }
  Bytes take_arrived() {
    Bytes all;
    while (!under_way_.empty() && under_way_.begin()->first <= now) {
      const Bytes& bytes = under_way_.begin()->second;
      all.insert(all.end(), bytes.begin(), bytes.end());
      under_way_.erase(under_way_.begin());
    }
    return all;
  }
  void opened() {
    if (!keeps_what_came) take_arrived();
  }
  void closed() {
    if (answers_end_with_it) under_way_.clear();
  }
  bool one_in(int number) { return random_below(number) == 0; }
  int random_below(int limit) { return std::uniform_int_distribution<int>(0, limit - 1)(random_); }

 private:
  void add(SteadyTime at, Bytes bytes) { under_way_.emplace(at, std::move(bytes)); }
  Duration delay(unsigned station) {
    const auto timeout = timeouts_.at(station).count();
    const auto latest = latest_.at(station).count();
    const auto from = [&](std::int64_t least, std::int64_t most) {
      return Duration(std::uniform_int_distribution<std::int64_t>(least, most)(random_));
    };
    if (one_in(6)) return from(timeout, latest);
    return one_in(20) ? Duration(latest) : from(1, timeout / 4);
  }
  /// Splits the last answer in two pieces.
  void half_of_the_last() {
    auto last = std::prev(under_way_.end());
    Bytes& bytes = last->second;
    const auto middle = bytes.begin() + static_cast<std::ptrdiff_t>(bytes.size() / 2);
    Bytes rest(middle, bytes.end());
    bytes.erase(middle, bytes.end());
    if (!rest.empty()) add(last->first, std::move(rest));
  }

  const Dialect& dialect_;
  std::map<unsigned, Duration> timeouts_;
  std::map<unsigned, Duration> latest_;
  std::mt19937 random_;
  std::multimap<SteadyTime, Bytes> under_way_;
  std::map<unsigned, SteadyTime> busy_until_;
  unsigned value_ = 0;
  Deed last_;
};

/// The agent's end of a LateWire. The LateWire outlives it.
class LateTransport final : public Transport {
 public:
  LateTransport(asio::any_io_executor executor, LateWire& wire)
      : executor_(std::move(executor)), wire_(wire) {}

  SteadyTime now() const override { return wire_.now; }
  asio::awaitable<Result<void>> open(SteadyTime /*deadline*/) override {
    co_await asio::post(executor_, asio::use_awaitable);
    open_ = true;
    wire_.opened();
    co_return Result<void>{};
  }
  bool is_open() const override { return open_; }
  asio::awaitable<Written> write(ByteView bytes, SteadyTime /*deadline*/) override {
    co_await asio::post(executor_, asio::use_awaitable);
    Written written;
    if (!alive()) {
      written.error = Error{ErrorCode::link_down, "closed"};
      co_return written;
    }
    wire_.hear(bytes);
    written.sent = bytes.size();
    co_return written;
  }
  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime deadline) override {
    co_await asio::post(executor_, asio::use_awaitable);
    if (!alive()) co_return fail(ErrorCode::link_down, "closed");
    const Bytes bytes = wire_.wait(deadline);
    if (!alive()) co_return fail(ErrorCode::link_down, "closed");
    if (bytes.empty()) co_return fail(ErrorCode::timeout, "nothing");
    std::copy(bytes.begin(), bytes.end(), into.begin());
    co_return bytes.size();
  }
  Result<Bytes> discard_input() override {
    if (!alive()) return fail(ErrorCode::link_down, "closed");
    return wire_.take_arrived();
  }
  void close() noexcept override {
    if (std::exchange(open_, false)) wire_.closed();
  }

 private:
  bool alive() const { return open_ && wire_.now < wire_.killed_at; }
  asio::any_io_executor executor_;
  LateWire& wire_;
  bool open_ = false;
};

}  // namespace fxagent::test
