// Asks single questions over one link and waits for each answer: for diagnosis from the command
// line. Never writes to a device. Runs on the caller's thread; use no other field object meanwhile.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "agent/config/model.h"
#include "protocol/codec.h"

namespace fxagent {

struct ProbeAnswer {
  enum class Kind : std::uint8_t {
    data,     ///< data or an ACK
    refused,  ///< the device is there, and refuses
    silent,   ///< nothing, except perhaps the echo of the request
    garbled,  ///< bytes that are no answer
    down,     ///< the link is not open
  } kind = Kind::silent;
  Bytes image{};        ///< data
  int device_code = 0;  ///< refused
  std::string text{};   ///< refused, garbled, down: the reason
  bool echo = false;    ///< the request came back before the answer
  /// From the end of the request to the end of the answer, without the time of its characters.
  std::chrono::milliseconds turnaround{0};

  bool is_answered() const { return kind == Kind::data || kind == Kind::refused; }
};

class LineProbe final {
 public:
  /// The link is closed at first. `gap` is the least silence before a request.
  explicit LineProbe(const LinkConfig& link, std::chrono::milliseconds gap = {});
  ~LineProbe();
  LineProbe(const LineProbe&) = delete;
  LineProbe& operator=(const LineProbe&) = delete;

  /// Opens the link, within 3 s. Error: link_down, with the place and the remedy.
  Result<void> open();
  /// Sends one request, after the silence that device and protocol need, and waits for its answer,
  /// for `timeout` beyond the time of the characters.
  /// Recognises an echo whatever the config says. A request that is no question is not sent.
  ProbeAnswer ask(const Codec& codec, const Request& request, std::chrono::milliseconds timeout);

 private:
  struct Line;
  std::unique_ptr<Line> line_;
};

}  // namespace fxagent
