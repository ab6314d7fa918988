#include "agent/field/bus/overheard.h"

#include <algorithm>

#include "agent/field/bus/unexpected_bytes.h"

namespace fxagent {
namespace {

// Unexpected bytes that are kept for display until the agent ends.
constexpr std::size_t kMostKept = 64;

}  // namespace

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
  } else if (late_.add_received(bytes.size()) && may_pass) {
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
