#include "tests/sim/station.h"

#include <algorithm>
#include <iterator>

namespace fxsim {
namespace {

constexpr std::size_t kOrdersKept = 100'000;

bool is_order(RequestKind kind) {
  return kind == RequestKind::write || kind == RequestKind::force_on ||
         kind == RequestKind::force_off;
}

}  // namespace

Station::Station(std::string name, std::unique_ptr<Personality> personality, Plc plc,
                 TimePoint start, std::chrono::system_clock::time_point wall_at_start,
                 OnExchange on_exchange, std::size_t questions_kept)
    : name_(std::move(name)),
      personality_(std::move(personality)),
      plc_(std::move(plc)),
      start_(start),
      wall_at_start_(wall_at_start),
      on_exchange_(std::move(on_exchange)),
      questions_kept_(questions_kept) {}

Answer Station::answer(const Frame& frame, TimePoint now) {
  const auto wall = wall_at_start_ +
                    std::chrono::duration_cast<std::chrono::system_clock::duration>(now - start_);
  const auto unix_ms =
      std::chrono::duration_cast<std::chrono::milliseconds>(wall.time_since_epoch()).count();
  const auto kind = personality_->kind(frame);
  stats_.bytes_in += frame.bytes.size();
  ++stats_.requests[static_cast<std::size_t>(kind)];
  if (auto command = personality_->command(frame); !command.empty())
    ++stats_.commands[std::move(command)];

  plc_.advance(now);
  const auto treatment = frame.whole ? faults_.treat(kind) : Treatment{};
  for (const auto fault : treatment.struck) ++stats_.faults[static_cast<std::size_t>(fault)];
  if (treatment.stop_plc) plc_.set_running(false);

  Ruling ruling{.verdict = Verdict::silent, .why = "fault"};
  if (treatment.execute) ruling = personality_->execute(frame, plc_);
  auto reply = ruling.reply;
  if (treatment.reply == Treatment::Reply::refusal) {
    reply = personality_->refusal(frame, treatment.code);
    ruling.verdict = Verdict::nak;
  } else if (treatment.reply == Treatment::Reply::none) {
    reply.clear();
  }
  if (ruling.verdict == Verdict::nak) ++stats_.naks;
  const bool done =
      treatment.execute && (ruling.verdict == Verdict::ack || ruling.verdict == Verdict::data);
  if (done) remember(kind, ruling, unix_ms);

  auto answer = schedule(frame, std::move(reply), treatment);
  answer.wait = ruling.wait;
  if (treatment.asked_twice && done) {
    ruling = personality_->execute(frame, plc_);
    remember(kind, ruling, unix_ms);
    answer.pieces.push_back({{}, ruling.reply, true});
  }
  if (on_exchange_) on_exchange_({name_, unix_ms, frame, kind, ruling, done, treatment, answer});
  return answer;
}

void Station::remember(RequestKind kind, const Ruling& ruling, std::int64_t unix_ms) {
  const bool order = is_order(kind);
  if (order) ++stats_.accepted_writes;
  if (kind == RequestKind::read) ++stats_.accepted_reads;
  auto& most = order ? stats_.most_written : stats_.most_read;
  if (order || kind == RequestKind::read) most = std::max(most, ruling.points);
  auto& deeds = order ? orders_ : questions_;
  deeds.push_back({next_index_++, unix_ms, kind, ruling.device, ruling.count, ruling.values});
  if (deeds.size() > (order ? kOrdersKept : questions_kept_)) deeds.pop_front();
}

Answer Station::schedule(const Frame& frame, Bytes reply, const Treatment& treatment) const {
  Answer answer;
  answer.hang_up = treatment.drop;
  answer.overtaken = treatment.overtaken;
  answer.coalesced = treatment.coalesced;
  answer.from_elsewhere = treatment.from_elsewhere;
  if (treatment.dead) return answer;
  if (treatment.echo) answer.pieces.push_back({{}, frame.bytes, false});
  if (reply.empty()) return answer;

  for (const auto flaw : treatment.flaws) personality_->spoil(reply, flaw);
  if (treatment.truncated_to) {
    const auto left = *treatment.truncated_to == 0 ? reply.size() / 2 : *treatment.truncated_to;
    reply.resize(std::min(left, reply.size()));
  }
  auto pause = treatment.delay;
  const auto add = [&](Bytes bytes) {
    if (bytes.empty()) return;
    answer.pieces.push_back({pause, std::move(bytes), true});
    pause = std::chrono::milliseconds(0);
  };
  add(treatment.before);
  if (treatment.split) {
    const auto size = treatment.split->bytes;
    for (std::size_t at = 0; at < reply.size(); at += size) {
      const auto first = std::next(reply.begin(), static_cast<std::ptrdiff_t>(at));
      const auto last =
          std::next(first, static_cast<std::ptrdiff_t>(std::min(size, reply.size() - at)));
      add(Bytes(first, last));
      pause = treatment.split->pause;
    }
    pause = std::chrono::milliseconds(0);
  } else {
    add(std::move(reply));
  }
  add(treatment.after);
  if (treatment.twice && !answer.pieces.empty()) {
    const auto once = answer.pieces.size();
    for (std::size_t i = 0; i < once; ++i) answer.pieces.emplace_back(answer.pieces[i]);
    answer.pieces[once].pause = *treatment.twice;
  }
  return answer;
}

std::vector<Deed> Station::deeds(std::uint64_t since) const {
  std::vector<Deed> found;
  std::ranges::merge(orders_, questions_, std::back_inserter(found), {}, &Deed::index,
                     &Deed::index);
  std::erase_if(found, [since](const Deed& deed) { return deed.index < since; });
  return found;
}

}  // namespace fxsim
