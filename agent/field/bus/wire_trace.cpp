#include "agent/field/bus/wire_trace.h"

#include <utility>

#include "agent/field/bus/wire.h"
#include "agent/log/log.h"
#include "agent/steady_time.h"
#include "agent/text/text.h"
#include "protocol/explanation.h"

namespace fxagent {
namespace {

using std::chrono::nanoseconds;
using Way = RecordedFrame::Way;

// Size of a log line without its bytes, each of which takes three characters.
constexpr std::size_t kLineBytes = 192;

}  // namespace

void WireTrace::speak_to(const Station& station) {
  recorded_as_ = station.recorded_as;
  if (!logs_) return;
  device_ = station.device;
  codec_ = station.codec;
}

void WireTrace::ended(const Exchange& exchange, ByteView bytes, SteadyTime now,
                      SteadyTime deadline) const {
  if (exchange.has_answer()) {
    const std::size_t size = exchange.reply.consumed - exchange.reply.began;
    return take(Way::in, bytes.subspan(exchange.reply.began, size), now, now - exchange.began);
  }
  const bool is_missing = exchange.outcome == Exchange::Outcome::unanswered;
  const nanoseconds within = (is_missing ? deadline : now) - exchange.began;
  std::string why = is_missing ? "" : exchange.error;
  if (why.empty())
    why = (bytes.empty() ? "no bytes within " : "no complete answer within ") + whole_ms(within) +
          " ms";
  take(Way::failed, bytes, now, within, std::move(why));
}

void WireTrace::take(Way way, ByteView bytes, SteadyTime at, nanoseconds after,
                     std::string note) const {
  if (ring_) ring_->add(way, recorded_as_, at, after, bytes, note);
  if (logs_) log(way, bytes, after, way == Way::unasked ? "unexpected bytes" : std::move(note));
}

void WireTrace::log(Way way, ByteView bytes, nanoseconds after, std::string note) const {
  auto make = [link = link_, device = device_, codec = way == Way::failed ? nullptr : codec_,
               copy = Bytes(bytes.begin(), bytes.end()), way, after, said = std::move(note)] {
    std::string says = said;
    if (codec) {
      const auto direction = way == Way::out ? Direction::request : Direction::reply;
      const std::string meaning = summary(codec->explain(copy, direction));
      says += (says.empty() ? "" : "; ") + meaning;
    }
    const std::string way_word = way == Way::out ? "out" : "in";
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
