#include "agent/field/line_probe.h"

#include <algorithm>
#include <array>
#include <asio/co_spawn.hpp>
#include <asio/io_context.hpp>
#include <asio/steady_timer.hpp>
#include <exception>
#include <utility>

#include "agent/field/transport/stream_io.h"
#include "agent/field/transport/transport.h"

namespace fxagent {
namespace {

constexpr std::chrono::seconds kOpening{3};
constexpr std::size_t kMostBytes = 4096;  // longer than any answer with its echo

bool is_question(const Request& request) {
  return brings_data(request) || std::holds_alternative<Enquire>(request);
}

}  // namespace

struct LineProbe::Line {
  Line(const LinkConfig& link, std::chrono::milliseconds least_gap)
      : transport(make_transport(io.get_executor(), link)),
        char_time(link.char_time),
        gap(least_gap),
        rest(io) {}

  /// Runs a coroutine to its end.
  void run(asio::awaitable<void> work) {
    std::exception_ptr fault;
    asio::co_spawn(io, std::move(work), [&](const std::exception_ptr& thrown) {
      fault = thrown;
      io.stop();  // the timer of a deadline may still run
    });
    io.restart();
    io.run();
    if (fault) std::rethrow_exception(fault);
  }
  asio::awaitable<void> open(Result<void>& outcome) {
    outcome = co_await transport->open(transport->now() + kOpening);
  }
  asio::awaitable<void> ask(const Codec& codec, const Request& request,
                            std::chrono::milliseconds timeout, ProbeAnswer& answer);

  asio::io_context io{1};
  std::unique_ptr<Transport> transport;
  std::chrono::nanoseconds char_time;
  std::chrono::nanoseconds gap;
  asio::steady_timer rest;
  SteadyTime quiet_since{};  ///< end of the last exchange
  std::uint16_t tag = 0;
};

asio::awaitable<void> LineProbe::Line::ask(const Codec& codec, const Request& request,
                                           std::chrono::milliseconds timeout, ProbeAnswer& answer) {
  using Kind = ProbeAnswer::Kind;
  const auto end = [&answer](Kind kind, const std::string& text) {
    answer.kind = kind;
    answer.text = text;
  };
  const auto frame = codec.encode(request, ++tag);
  if (!frame) co_return end(Kind::garbled, frame.error().text);
  co_await wait_until(rest, quiet_since + std::max(gap, codec.quiet_before(char_time)));
  if (const auto old = transport->discard_input(); !old)
    co_return end(Kind::down, old.error().text);
  const auto length = codec.line_length(request);
  const auto began = transport->now() + char_time * length.request_chars;
  const auto deadline =
      began + timeout +
      char_time * (length.request_chars + length.reply_chars + length.more_reply_chars);
  const auto written = co_await transport->write(*frame, deadline);
  if (written.error) co_return end(Kind::down, written.error->text);
  Bytes rx;
  std::array<std::uint8_t, 512> part{};
  for (;;) {
    const auto count = co_await transport->read_some(part, deadline);
    // A sender that never pauses is no answer.
    const bool is_over = !count || rx.size() > kMostBytes || transport->now() > deadline;
    if (!count && count.error().code != ErrorCode::timeout)
      co_return end(Kind::down, count.error().text);
    if (count)
      rx.insert(rx.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(*count));
    const auto [own, got] = std::ranges::mismatch(*frame, rx);
    if (!answer.echo && own == frame->end()) {
      answer.echo = true;
      rx.erase(rx.begin(), got);
    } else if (!is_over && !answer.echo && got == rx.end()) {
      continue;  // may become an echo
    }
    if (is_over && rx.empty()) co_return end(Kind::silent, {});
    const auto reply =
        rx.empty() ? Result<std::optional<Reply>>{std::nullopt} : codec.decode(request, tag, rx);
    if (reply && *reply) {
      answer.turnaround = std::chrono::duration_cast<std::chrono::milliseconds>(std::max(
          transport->now() - began - char_time * (length.reply_chars + length.more_reply_chars),
          SteadyTime::duration{0}));
      answer.image = (*reply)->image;
      answer.device_code = (*reply)->device_code;
      if (!(*reply)->closing.empty()) co_await transport->write((*reply)->closing, deadline);
      const bool is_nak = (*reply)->kind == Reply::Kind::nak;
      co_return end(is_nak ? Kind::refused : Kind::data, (*reply)->text);
    }
    if (is_over) co_return end(Kind::garbled, reply ? "an incomplete answer" : reply.error().text);
  }
}

LineProbe::LineProbe(const LinkConfig& link, std::chrono::milliseconds gap)
    : line_(std::make_unique<Line>(link, gap)) {}
LineProbe::~LineProbe() = default;

Result<void> LineProbe::open() {
  Result<void> outcome;
  line_->run(line_->open(outcome));
  return outcome;
}

ProbeAnswer LineProbe::ask(const Codec& codec, const Request& request,
                           std::chrono::milliseconds timeout) {
  ProbeAnswer answer;
  if (!is_question(request)) {
    answer.kind = ProbeAnswer::Kind::garbled;
    answer.text = "not sent: the request would change the device";
    return answer;
  }
  line_->run(line_->ask(codec, request, timeout, answer));
  line_->quiet_since = std::chrono::steady_clock::now();
  return answer;
}

}  // namespace fxagent
