#include "tests/agent/path/path_judge.h"

#include <algorithm>
#include <cstdint>
#include <optional>

namespace fxagent::test {
namespace {

using Json = nlohmann::json;

/// How far a target came on the device.
struct Done {
  std::uint32_t done = 0;
  std::uint32_t of = 0;
  bool nothing = true;
  bool twice = false;
  bool is_whole() const { return done == of; }
};

Done done_of(const WantedTarget& target, const LedgerDevice& device) {
  Done out;
  for (const std::vector<Deed>& element : target.elements) {
    bool whole = true;
    for (const Deed& deed : element) {
      const auto found = device.ledger.find(deed);
      const int times = found == device.ledger.end() ? 0 : found->second;
      whole = whole && times > 0;
      out.nothing = out.nothing && times == 0;
      out.twice = out.twice || times > 1;
    }
    out.of += target.per_element;
    if (whole) out.done += target.per_element;
  }
  return out;
}

/// Of a command, by target; of run and stop the one that was switched.
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

std::optional<std::uint32_t> number(const Json& result, const char* key) {
  if (!result.contains(key)) return std::nullopt;
  return result[key].get<std::uint32_t>();
}

/// What a status promises of a target that takes one command's place, and of a command with one.
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
  const bool nothing = std::all_of(all.begin(), all.end(), [](const Done& d) { return d.nothing; });
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

/// Whether `result` may be said of `sent`, given what the device did.
std::string judge_result(const SentCommand& sent, const Json& result, const LedgerDevice& device) {
  const std::vector<Done> all = done_of(sent, device);
  for (const Done& done : all)
    if (done.twice) return "carried out twice";
  const std::string status = result["status"];
  if (sent.is_wrong && status != "REJECTED") return status + " of what is no command";
  const bool nothing = std::all_of(all.begin(), all.end(), [](const Done& d) { return d.nothing; });
  if (sent.dry_run || sent.is_wrong) {
    if (!nothing) return "something was carried out";
    return status == "SUCCEEDED" || status == "REJECTED" || status == "EXPIRED"
               ? ""
               : status + " of what was not to be sent";
  }
  if (all.empty()) {  // a read
    if (status == "PARTIAL" || status == "UNKNOWN_OUTCOME") return status + " of a read";
    return status == "SUCCEEDED" && result["value"].is_null() ? "SUCCEEDED without a value" : "";
  }
  if (sent.op == "run" || sent.op == "stop") {
    // A PLC that is in the wanted state already need not be switched; one that was may be switched
    // back by a hand.
    const bool refused =
        status != "SUCCEEDED" && status != "UNKNOWN_OUTCOME" && !is_mismatch(result);
    return refused && !nothing ? status + ", and the PLC was switched" : "";
  }
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
    ++counted[status];
    return;
  }
  const Json& id = result["id"];  // an integer is the same id as its text
  Known& known = known_[{device, id.is_string() ? id.get<std::string>() : id.dump()}];
  if (status == "DUPLICATE") {
    ++counted[status];
    known.duplicates.push_back(std::move(result));
    return;
  }
  if (known.results.empty()) ++counted[status];
  known.results.push_back(std::move(result));
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
    const Json& told = duplicate["first"];
    if (!told.is_null() && told["status"] != first["status"])
      return "DUPLICATE of another outcome than was told";
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
  // Of several messages with one id one is the command; a crash can make it the second.
  std::string first_why;
  for (std::size_t i = 0; i < known.sent.size(); ++i) {
    std::string why = judge_result(known.sent[i], known.results[0], device);
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

/// What the device did and nobody wanted, and values that no tag may have.
std::string PathJudge::judge_ledger(std::uint32_t index, const LedgerDevice& device) const {
  std::set<Deed> wanted;
  for (const auto& [key, known] : known_)
    if (key.first == index)
      for (const SentCommand& sent : known.sent)
        for (const WantedTarget& target : sent.targets)
          for (const auto& element : target.elements) wanted.insert(element.begin(), element.end());
  std::string out;
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

std::string PathJudge::verdict(const std::vector<LedgerDevice*>& devices,
                               const LastingJournal& journal,
                               const std::vector<std::string>& names) {
  std::string out = judge_unreadable();
  for (std::uint32_t i = 0; i < devices.size(); ++i) out += judge_ledger(i, *devices[i]);
  for (const auto& [key, known] : known_) {
    const std::string why =
        judge(key, known, *devices[key.first], journal.has(names[key.first], key.second));
    if (!why.empty()) out += names[key.first] + ": " + why + "\n" + told(key.first, key.second);
  }
  return out;
}

std::string PathJudge::told(std::uint32_t device, const std::string& id) const {
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
