#include "tests/agent/path/path_judge.h"

#include <algorithm>
#include <cstdint>
#include <optional>

namespace fxagent::test {
namespace {

using Json = nlohmann::json;

/// The part of a target that the device carried out.
struct Done {
  std::uint32_t done = 0;
  std::uint32_t of = 0;
  bool nothing = true;
  bool twice = false;
  bool is_whole() const { return done == of; }
};

Done done_of(const WantedTarget& target, const LedgerDevice& device) {
  Done out;
  // Each element of a text is a word of two characters; the last may have only one.
  const bool is_text = target.place.kind == Kind::text && target.place.count == 0;
  for (const std::vector<Part>& element : target.elements) {
    bool whole = true;
    for (const Part& part : element) {
      const auto found = device.ledger.find(part.deed);
      const int times = found == device.ledger.end() ? 0 : found->second;
      whole = whole && times > 0;
      out.nothing = out.nothing && times == 0;
      out.twice = out.twice || times > 1;
    }
    out.of += is_text ? 2 : 1;
    if (whole) out.done += is_text ? 2 : 1;
  }
  if (is_text) {
    out.of = target.place.length;
    out.done = std::min(out.done, out.of);
  }
  return out;
}

/// Returns one entry per target; for run and stop, one for the switch.
std::vector<Done> done_of(const SentCommand& sent, const LedgerDevice& device) {
  std::vector<Done> out;
  if (sent.op == "run" || sent.op == "stop") {
    const auto found = device.switched.find(sent.op);
    const int times = found == device.switched.end() ? 0 : found->second;
    out.push_back({times > 0 ? 1U : 0U, 1, times == 0, times > 1});
  }
  for (const WantedTarget& target : sent.targets) out.push_back(done_of(target, device));
  return out;
}

bool is_mismatch(const Json& result) { return result.value("reason", Json()) == "verify_mismatch"; }

bool is_empty(const std::vector<Done>& all) {
  return std::all_of(all.begin(), all.end(), [](const Done& done) { return done.nothing; });
}

std::optional<std::uint32_t> number(const Json& result, const char* key) {
  if (!result.contains(key)) return std::nullopt;
  return result[key].get<std::uint32_t>();
}

/// Checks the status of a target, or of a command with a single target.
std::string judge_one(const Json& result, const Done& done) {
  const std::string status = result["status"];
  if (status == "FAILED" && is_mismatch(result))
    return done.is_whole() ? "" : "verify_mismatch of what was not carried out";
  if (status == "REJECTED" || status == "EXPIRED" || status == "FAILED")
    return done.nothing ? "" : status + ", and something was carried out";
  if (status == "SUCCEEDED") return done.is_whole() ? "" : "SUCCEEDED, and not all was carried out";
  const auto said = number(result, "done");
  if (status == "UNKNOWN_OUTCOME")
    return said && *said > done.done ? "UNKNOWN_OUTCOME with more done than was" : "";
  if (status != "PARTIAL") return "no status that a target has: " + status;
  if (said != done.done || number(result, "of") != done.of)
    return "PARTIAL: really " + std::to_string(done.done) + " of " + std::to_string(done.of);
  return done.done == 0 || done.is_whole() ? "PARTIAL of nothing or of all" : "";
}

std::string judge_list(const Json& result, const std::vector<Done>& all) {
  const std::string status = result["status"];
  const bool nothing = is_empty(all);
  const auto whole = static_cast<std::uint32_t>(
      std::count_if(all.begin(), all.end(), [](const Done& d) { return d.is_whole(); }));
  if (status == "REJECTED" || status == "EXPIRED" || (status == "FAILED" && !is_mismatch(result)))
    return nothing ? "" : status + ", and something was carried out";
  if (status == "SUCCEEDED" || status == "FAILED")
    if (whole != all.size()) return status + ", and not all was carried out";
  if (!result.contains("targets") || result["targets"].size() != all.size())
    return result.contains("detail") && status == "UNKNOWN_OUTCOME" ? "" : "targets are missing";
  const auto said = number(result, "done");
  if (status == "PARTIAL" && (said != whole || number(result, "of") != all.size()))
    return "PARTIAL: really " + std::to_string(whole) + " of " + std::to_string(all.size());
  if (status == "PARTIAL" && nothing) return "PARTIAL of nothing";
  if (status == "UNKNOWN_OUTCOME" && said && *said > whole)
    return "UNKNOWN_OUTCOME with more done than was";
  for (std::size_t i = 0; i < all.size(); ++i) {
    const std::string why = judge_one(result["targets"][i], all[i]);
    if (!why.empty()) return "target " + std::to_string(i) + ": " + why;
  }
  return "";
}

/// Checks the values in a result: a read value must have existed, a written value must be the
/// requested one.
std::string judge_values(const WantedTarget& target, const Json& result, const std::string& op,
                         const LedgerDevice& device, TimeSpan when) {
  const Json verify = result.value("verify", Json());
  if (verify.is_object() && !verify["read"].is_null() &&
      !was_shown(target.place, verify["read"], device, when))
    return "a value was read back that was never there";
  if (op == "write" && verify.is_object() && !verify["read"].is_null() &&
      result.value("reason", Json()) != "expect_mismatch") {
    const bool same = elements_of(target.place, verify["read"], device) == target.elements;
    if (verify["match"] != same) return "`match` is not what was read back";
    if (result["status"] == "SUCCEEDED" && !same) return "SUCCEEDED, and another value was read";
    if (is_mismatch(result) && same) return "verify_mismatch, and what was written was read";
  }
  const bool says_value = result["status"] == "SUCCEEDED" || result["status"] == "PARTIAL";
  if (op != "write" || !says_value) return "";
  const auto said = elements_of(target.place, result.value("value", Json()), device);
  return said == target.elements ? "" : "another value than was to be written";
}

std::string judge_values(const SentCommand& sent, const Json& result, const LedgerDevice& device,
                         TimeSpan when) {
  if (sent.read && result["status"] == "SUCCEEDED")
    return was_shown(*sent.read, result["value"], device, when) ? ""
                                                                : "it read what was never there";
  if (sent.targets.empty()) return "";
  if (!sent.is_list) return judge_values(sent.targets[0], result, sent.op, device, when);
  const Json targets = result.value("targets", Json());
  std::string why;
  for (std::size_t i = 0; i < targets.size() && why.empty(); ++i)
    why = judge_values(sent.targets[i], targets[i], sent.op, device, when);
  return why;
}

/// Returns the time up to just before the device started on the target.
TimeSpan before_done(const WantedTarget& target, const LedgerDevice& device, TimeSpan when) {
  for (const std::vector<Part>& element : target.elements)
    for (const Part& part : element)
      if (const auto done = device.first_done.find(part.deed); done != device.first_done.end())
        when.to = std::min(when.to, done->second - std::chrono::nanoseconds(1));
  return when;
}

std::string judge_expect(const SentCommand& sent, const Json& result, const std::vector<Done>& all,
                         const LedgerDevice& device, TimeSpan when) {
  const bool mismatch = result.value("reason", Json()) == "expect_mismatch";
  if (!sent.expect) return mismatch ? "expect_mismatch, and nothing was expected" : "";
  if (mismatch) {
    const Json verify = result.value("verify", Json());
    if (!verify.is_object() || verify["read"].is_null()) return "what was found is not said";
    return verify["read"] == *sent.expect ? "expect_mismatch of what was expected" : "";
  }
  const WantedTarget& target = sent.targets[0];
  const bool held =
      was_shown(target.place, *sent.expect, device, before_done(target, device, when));
  return is_empty(all) || held ? "" : "it was carried out, and the device never held `expect`";
}

/// A PLC that is already in the wanted state need not be switched; after a switch, someone may
/// switch it back by hand.
std::string judge_switch(const SentCommand& sent, const Json& result, const Done& done,
                         const LedgerDevice& device, TimeSpan when) {
  const std::string status = result["status"];
  const bool refused = status != "SUCCEEDED" && status != "UNKNOWN_OUTCOME" && !is_mismatch(result);
  if (refused && !done.nothing) return status + ", and the PLC was switched";
  const Json verify = result.value("verify", Json());
  if (verify.is_object() && !device.was_running(verify["read"] == "run", when))
    return "the PLC was never in the state that was read";
  if (status != "SUCCEEDED") return "";
  if (!device.was_running(sent.op == "run", when)) return "SUCCEEDED, and the PLC never was so";
  return result["plc"] == "ACK" && done.nothing ? "ACK, and the PLC was never asked" : "";
}

/// Checks `result` against `sent` if the command was not sent, for example because it was refused.
std::string judge_unsent(const SentCommand& sent, const Json& result, bool nothing) {
  const std::string status = result["status"];
  const Json reason = result.value("reason", Json());
  if (sent.is_wrong && status != "REJECTED") return status + " of what is no command";
  if (!nothing) return "something was carried out";
  if (sent.in_conflict && status == "SUCCEEDED") return "SUCCEEDED beside another agent";
  const bool comes_before = sent.is_wrong || reason == "out_of_range" || reason == "queue_full";
  if (sent.in_conflict && status == "REJECTED" && reason != "conflict" && !comes_before)
    return "REJECTED beside another agent, and not for that";
  return status == "SUCCEEDED" || status == "REJECTED" || status == "EXPIRED"
             ? ""
             : status + " of what was not to be sent";
}

/// Checks `result`, published at the end of `when`, against `sent` and the device's actual writes.
/// `conflicts`: when another agent got the same id.
std::string judge_result(const SentCommand& sent, const Json& result, const LedgerDevice& device,
                         TimeSpan when, const std::vector<SteadyTime>& conflicts) {
  const std::vector<Done> all = done_of(sent, device);
  for (const Done& done : all)
    if (done.twice) return "carried out twice";
  if (sent.dry_run || sent.is_wrong || sent.in_conflict)
    return judge_unsent(sent, result, is_empty(all));
  const std::string status = result["status"];
  const Json reason = result.value("reason", Json());
  if (reason == "conflict" && std::ranges::none_of(conflicts, [when](SteadyTime began) {
        return began >= when.from && began <= when.to;
      }))
    return "there was no other agent";
  if (status == "PARTIAL" && reason == "expired") return "what was under way was not finished";
  if (sent.op == "run" || sent.op == "stop")
    return judge_switch(sent, result, all[0], device, when);
  if (std::string why = judge_values(sent, result, device, when); !why.empty()) return why;
  if (std::string why = judge_expect(sent, result, all, device, when); !why.empty()) return why;
  if (sent.read)
    return status == "PARTIAL" || status == "UNKNOWN_OUTCOME" ? status + " of a read" : "";
  if (sent.is_list) return judge_list(result, all);
  return judge_one(result, all[0]);
}

Json without_times(Json result) {
  result.erase("t");
  return result;
}

}  // namespace

void PathJudge::received(const SentCommand& sent) {
  if (sent.id.empty())
    unreadable_.push_back(sent);
  else
    known_[{sent.device, sent.id}].sent.push_back(sent);
}

void PathJudge::published(std::uint32_t device, const std::string& text) {
  Json result = Json::parse(text);
  const std::string status = result["status"];
  if (result["id"].is_null()) {
    ++without_id_;
    count(result);
    return;
  }
  const Json& id = result["id"];  // an integer is the same id as its text
  Known& known = known_[{device, id.is_string() ? id.get<std::string>() : id.dump()}];
  if (status == "DUPLICATE") {
    count(result);
    known.duplicates.push_back(std::move(result));
    return;
  }
  if (known.results.empty()) {
    count(result);
    known.published_at = std::chrono::steady_clock::now();
  }
  known.results.push_back(std::move(result));
}

void PathJudge::count(const Json& result) {
  ++counted[result["status"]];
  const Json& reason = result["reason"];
  if (!reason.is_string()) return;
  const bool is_read = result["op"] == "read";
  ++by_reason[result["status"].get<std::string>() + " " + reason.get<std::string>() +
              (is_read ? " (read)" : "")];
}

bool PathJudge::may_be_lost(const Known& known) const {
  return std::any_of(known.sent.begin(), known.sent.end(),
                     [this](const SentCommand& each) { return killed_.contains(each.life); });
}

std::string PathJudge::judge_results(const Known& known) const {
  if (known.results.empty()) return "";
  const Json first = without_times(known.results[0]);
  for (const Json& result : known.results)
    if (without_times(result) != first) return "two outcomes";
  for (const Json& duplicate : known.duplicates) {
    const Json& first_said = duplicate["first"];
    if (!first_said.is_null() && first_said["status"] != first["status"])
      return "DUPLICATE of another outcome than was published";
  }
  if (!may_be_lost(known) && known.duplicates.size() + 1 != known.sent.size())
    return "not one result for each message";
  return "";
}

std::string PathJudge::judge(const Key& key, const Known& known, const LedgerDevice& device,
                             bool in_journal) const {
  if (known.sent.empty()) return "a result of what was never sent";
  if (known.results.empty()) {
    if (in_journal) return "it is in the journal and has no result";
    if (!may_be_lost(known)) return "no result";
    for (const SentCommand& sent : known.sent)
      for (const Done& done : done_of(sent, device))
        if (!done.nothing) return "no result, and something was carried out";
    return "";
  }
  if (std::string why = judge_results(known); !why.empty()) return why;
  // Of several messages with one id, one is the command; after a crash it may be the second.
  std::string first_why;
  for (std::size_t i = 0; i < known.sent.size(); ++i) {
    std::string why = judge_result(known.sent[i], known.results[0], device,
                                   {known.sent[i].sent_at, known.published_at}, conflicts_);
    for (std::size_t j = 0; j < known.sent.size() && why.empty(); ++j)
      if (known.sent[j].payload != known.sent[i].payload)
        for (const Done& done : done_of(known.sent[j], device))
          if (!done.nothing) why = "a message with the same id was carried out too";
    if (why.empty()) return "";
    if (first_why.empty()) first_why = why;
    if (!may_be_lost(known)) break;
  }
  return first_why + " (" + key.second + ")";
}

std::string PathJudge::judge_unreadable() const {
  const bool lost = std::any_of(unreadable_.begin(), unreadable_.end(),
                                [this](const auto& each) { return killed_.contains(each.life); });
  const auto sent = static_cast<int>(unreadable_.size());
  if (without_id_ > sent || (!lost && without_id_ != sent))
    return std::to_string(sent) + " messages without an id had " + std::to_string(without_id_) +
           " results\n";
  return "";
}

/// Finds writes that no command requested, and values that no tag can have.
std::string PathJudge::judge_ledger(std::uint32_t index, const LedgerDevice& device) const {
  std::set<Deed> wanted;
  for (const auto& [key, known] : known_)
    if (key.first == index)
      for (const SentCommand& sent : known.sent)
        for (const WantedTarget& target : sent.targets)
          for (const auto& element : target.elements)
            for (const Part& part : element) wanted.insert(part.deed);
  std::string out;
  for (const std::string& fault : device.faults) out += fault + "\n";
  for (const auto& [deed, times] : device.ledger) {
    const std::string what = std::string(deed.is_bit ? "bit " : "word ") +
                             std::to_string(deed.number) + " = " + std::to_string(deed.value);
    if (!wanted.contains(deed)) out += what + " was set, and nobody asked for it\n";
    const bool limited =
        !deed.is_bit && deed.number >= kFirstLimited && deed.number <= kLastLimited;
    if (limited && (deed.value < 4 || deed.value > 999))
      out += what + " lies outside of min and max\n";
  }
  return out;
}

std::string PathJudge::judge_all(const std::vector<LedgerDevice*>& devices,
                                 const LastingJournal& journal,
                                 const std::vector<std::string>& names) {
  std::string out = judge_unreadable();
  for (std::uint32_t i = 0; i < devices.size(); ++i) out += judge_ledger(i, *devices[i]);
  for (const auto& [key, known] : known_) {
    const std::string why =
        judge(key, known, *devices[key.first], journal.has(names[key.first], key.second));
    if (!why.empty())
      out += names[key.first] + ": " + why + "\n" + messages_of(key.first, key.second);
  }
  return out;
}

std::string PathJudge::messages_of(std::uint32_t device, const std::string& id) const {
  std::string out;
  const Known& known = known_.at({device, id});
  for (const SentCommand& sent : known.sent)
    out += "  > life " + std::to_string(sent.life) + (killed_.contains(sent.life) ? "+ " : " ") +
           sent.payload.substr(0, 300) + "\n";
  for (const Json& result : known.results) out += "  < " + result.dump().substr(0, 1200) + "\n";
  for (const Json& result : known.duplicates) out += "  < " + result.dump().substr(0, 300) + "\n";
  return out;
}

}  // namespace fxagent::test
