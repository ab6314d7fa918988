#include "agent/field/bus/overheard.h"

#include <algorithm>

#include "agent/field/bus/unexpected_bytes.h"

namespace fxagent {
namespace {

// Unexpected bytes that are kept for display until the agent ends.
constexpr std::size_t kMostKept = 64;

}  // namespace

void BusDoubt::found_foreign(SteadyTime now) {
  ++findings_;
  was_out_of_step(now);
  if (!is_doubted()) {
    const bool relapse = doubts_ > 0 && now - ended_ < kRelapse;
    wanted_ = relapse ? std::min(wanted_ * 2, kMostExchanges) : kCleanExchanges;
    ++doubts_;
  }
  exchanges_to_go_ = wanted_;
}

void BusDoubt::exchange_was_clean(SteadyTime now) {
  if (!is_doubted()) return;
  --exchanges_to_go_;
  if (!is_doubted()) ended_ = now;
}

void BusDoubt::exchange_was_unclear() {
  if (is_doubted()) exchanges_to_go_ = wanted_;
}

Bytes Echo::answered(Bytes before, const Bytes& request, bool shows) {
  const auto own = std::search(before.begin(), before.end(), request.begin(), request.end());
  const bool echoed = own != before.end();
  if (shows) {
    in_a_row_ = echoed ? std::min(in_a_row_ + 1, kFound) : 0;
    returns_nothing_ = before.empty();
  }
  if (echoed) before.erase(own, own + static_cast<std::ptrdiff_t>(request.size()));
  return before;
}

bool Echo::may_be(ByteView bytes) const {
  if (returns_nothing_) return false;
  // The line echoes. Either this is not detected yet, or the echoed bytes get no answer.
  return std::ranges::equal(bytes, last_sent_) || !std::ranges::search(unanswered_, bytes).empty();
}

std::size_t Overheard::judge(const Codec& codec, ByteView bytes, SteadyTime now) {
  last_received_ = now;
  if (echo_.may_be(bytes)) return 0;
  const ByteView shown = bytes.first(std::min(bytes.size(), kMostJudged));
  keep(shown);
  // Foreign bytes do no harm if answers carry numbers or arrive on ports of their own.
  if (tells_answers_apart(codec)) return bytes.size();
  const bool may_pass = codec.may_pass_for_answer(shown);
  if (late_.owed() == LateAnswers::Owed::none) {
    if (may_pass) doubt_.found_foreign(now);
  } else if (late_.came(bytes.size()) && may_pass) {
    // The bus waits for the answer that is owed. More than that one is a second answer, or
    // another's.
    doubt_.was_out_of_step(now);
  }
  return bytes.size();
}

bool Overheard::is_out_of_step(const Codec& codec, const Exchange& exchange) const {
  return !exchange.has_answer() && !exchange.received.empty() && !tells_answers_apart(codec) &&
         !echo_.may_be(exchange.received) && codec.explain(exchange.received, Direction::reply).ok;
}

bool Overheard::is_silence(const Exchange& exchange) const {
  return exchange.outcome == Exchange::Outcome::unanswered &&
         (exchange.received.empty() || echo_.may_be(exchange.received));
}

std::string Overheard::unexpected_text() const { return first_bytes(last_unexpected_, kMostKept); }

void Overheard::keep(ByteView bytes) {
  const ByteView kept = bytes.first(std::min(bytes.size(), kMostKept));
  last_unexpected_.assign(kept.begin(), kept.end());
}

}  // namespace fxagent
