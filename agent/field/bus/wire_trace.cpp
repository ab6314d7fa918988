#include "agent/field/bus/wire_trace.h"

#include <cstdio>
#include <utility>

#include "agent/log/log.h"
#include "agent/steady_time.h"
#include "protocol/explanation.h"

namespace fxagent {
namespace {

using std::chrono::nanoseconds;

// Size of a log line without its bytes, each of which takes three characters.
constexpr std::size_t kLineBytes = 192;

std::string ms_text(nanoseconds duration) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f",
                std::chrono::duration<double, std::milli>(duration).count());
  return text;
}

}  // namespace

void WireTrace::speak_to(std::string_view device, std::shared_ptr<const Codec> codec) {
  device_ = device;
  codec_ = std::move(codec);
}

void WireTrace::out(ByteView bytes) const {
  show(WireFrame::Way::out, bytes, nanoseconds(0), {}, Explained::yes);
}

void WireTrace::answer(ByteView bytes, nanoseconds after) const {
  show(WireFrame::Way::in, bytes, after, {}, Explained::yes);
}

void WireTrace::no_answer(ByteView bytes, nanoseconds within, std::string why) const {
  if (why.empty())
    why = (bytes.empty() ? "no bytes within " : "no complete answer within ") + whole_ms(within) +
          " ms";
  show(WireFrame::Way::in, bytes, within, std::move(why), Explained::no);
}

void WireTrace::ended(const Exchange& exchange, ByteView bytes, SteadyTime now,
                      SteadyTime deadline) const {
  if (exchange.has_answer()) {
    const std::size_t size = exchange.reply.consumed - exchange.reply.began;
    answer(bytes.subspan(exchange.reply.began, size), now - exchange.began);
  } else if (exchange.outcome == Exchange::Outcome::unanswered) {
    no_answer(bytes, deadline - exchange.began, {});
  } else {
    no_answer(bytes, now - exchange.began, exchange.error);
  }
}

void WireTrace::unasked(ByteView bytes) const {
  show(WireFrame::Way::in, bytes, nanoseconds(0), "unexpected bytes", Explained::yes);
}

void WireTrace::show(WireFrame::Way way, ByteView bytes, nanoseconds after, std::string note,
                     Explained explained) const {
  auto make = [link = link_, device = device_,
               codec = explained == Explained::yes ? codec_ : nullptr,
               copy = Bytes(bytes.begin(), bytes.end()), way, after, said = std::move(note)] {
    std::string says = said;
    if (codec) {
      const auto direction = way == WireFrame::Way::out ? Direction::request : Direction::reply;
      const std::string meaning = summary(codec->explain(copy, direction));
      says += (says.empty() ? "" : "; ") + meaning;
    }
    const std::string way_word = way == WireFrame::Way::out ? "out" : "in";
    log::Fields fields{{"link", link}};
    if (!device.empty()) fields.emplace_back("device", device);
    fields.emplace_back("way", way_word);
    if (!copy.empty()) fields.emplace_back("bytes", to_hex(copy));
    if (after.count() > 0) fields.emplace_back("after_ms", ms_text(after));
    fields.emplace_back("says", says);
    return log::body("frame", fields);
  };
  log::trace(std::chrono::system_clock::now(), kLineBytes + 3 * bytes.size(), std::move(make));
}

}  // namespace fxagent
