#include "agent/pair/pair_messages.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/config/keys.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "agent/text/text.h"
#include "protocol/value/bytes.h"

namespace fxagent::pair_messages {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestName = 64;
constexpr std::size_t kLongestId = 64;  // of a command

std::optional<json> object_from(std::string_view text) {
  if (text.size() > kLongestText) return std::nullopt;
  json found = parsed_json(text);
  if (!found.is_object()) return std::nullopt;
  return found;
}

template <class Number>
Number number(const json& from, const char* key) {
  const json& value = member(from, key);
  const bool is_natural = value.is_number_unsigned() || (value.is_number_integer() && value >= 0);
  return is_natural ? value.get<Number>() : 0;
}

bool is_plain(std::string_view text) {
  return !text.empty() && text.size() <= kLongestName &&
         std::ranges::all_of(text, [](char c) { return c > ' ' && c <= '~'; });
}

}  // namespace

std::string topic_of(const std::string& base, const std::string& member) {
  return base + "/pair/" + member;
}

std::optional<Place> place_of(std::string_view topic, const std::string& base) {
  const std::string begin = topic_of(base, "");
  if (!topic.starts_with(begin)) return std::nullopt;
  topic.remove_prefix(begin.size());
  const auto slash = topic.find('/');
  const std::string_view member = topic.substr(0, slash);
  if (!is_name(member)) return std::nullopt;
  const std::string_view leaf = slash == topic.npos ? std::string_view() : topic.substr(slash + 1);
  if (slash != topic.npos && leaf != "heartbeat" && leaf != "journal") return std::nullopt;
  return Place{std::string(member), std::string(leaf)};
}

std::string status(const PairStatus& status) {
  const auto quiet = std::chrono::duration_cast<std::chrono::milliseconds>(status.quiet);
  fxagent::json::Writer out;
  out.begin_object().key("member").string(status.member).key("boot").string(status.boot);
  out.key("role").string(status.role).key("quiet_ms").integer(quiet.count());
  if (status.role != "offline") {
    out.key("since_ms").integer(status.since_ms).key("peer").word(status.peer);
    out.key("why").string(status.why);
    if (status.is_third) out.key("third").boolean(true);
  }
  return out.end_object().take();
}

std::optional<PairStatus> status_from(std::string_view text) {
  const auto found = object_from(text);
  if (!found) return std::nullopt;
  PairStatus status;
  status.member = text_at(*found, "member");
  status.boot = text_at(*found, "boot");
  status.role = text_at(*found, "role");
  status.is_third = member(*found, "third") == json(true);
  constexpr std::int64_t longest = config_key("pair.quiet_ms").limits.max;
  status.quiet =
      std::chrono::milliseconds(std::min(number<std::int64_t>(*found, "quiet_ms"), longest));
  if (!is_name(status.member) || !is_plain(status.boot) || !is_plain(status.role))
    return std::nullopt;
  return status;
}

std::string heartbeat(const Heartbeat& heartbeat, std::uint64_t number) {
  fxagent::json::Writer out;
  out.begin_object().key("boot").string(heartbeat.boot).key("n").integer(number);
  return out.key("seq").integer(heartbeat.seq).end_object().take();
}

std::optional<Heartbeat> heartbeat_from(std::string_view text) {
  const auto found = object_from(text);
  if (!found) return std::nullopt;
  Heartbeat heartbeat{text_at(*found, "boot"), number<std::uint64_t>(*found, "seq")};
  if (!is_plain(heartbeat.boot)) return std::nullopt;
  // A larger number would leave no room for the numbers after it.
  heartbeat.seq =
      std::min(heartbeat.seq, static_cast<std::uint64_t>(fxagent::json::kMaxExactInteger) / 2);
  return heartbeat;
}

std::string announcement(const Announcement& announcement) {
  fxagent::json::Writer out;
  out.begin_object().key("boot").string(announcement.boot);
  if (announcement.mark != 0) return out.key("mark").integer(announcement.mark).end_object().take();
  const JournalEntry& entry = announcement.entry;
  out.key("device").string(entry.device).key("id").string(entry.id).key("op").string(entry.op);
  out.key("received_ms").integer(entry.received_ms).key("deadline_ms").integer(entry.deadline_ms);
  if (!entry.response_topic.empty()) out.key("response_topic").string(entry.response_topic);
  if (!entry.correlation.empty()) out.key("correlation").string(to_hex(entry.correlation));
  if (announcement.id_is_number) out.key("id_is_number").boolean(true);
  if (announcement.unanswered) out.key("unanswered").boolean(true);
  if (announcement.answered) out.key("answered").boolean(true);
  if (entry.surely_not_sent) out.key("unsent").boolean(true);
  if (entry.refused) out.key("refused").boolean(true);
  if (!entry.result.empty()) out.key("result").string(entry.result);
  return out.end_object().take();
}

std::optional<Announcement> announcement_from(std::string_view text) {
  const auto found = object_from(text);
  if (!found) return std::nullopt;
  Announcement announcement;
  announcement.boot = text_at(*found, "boot");
  announcement.mark = number<std::uint64_t>(*found, "mark");
  JournalEntry& entry = announcement.entry;
  entry.device = text_at(*found, "device");
  entry.id = text_at(*found, "id");
  const auto is_set = [&](const char* key) { return member(*found, key) == json(true); };
  announcement.id_is_number = is_set("id_is_number");
  if (announcement.id_is_number) entry.payload = R"({"id":)" + entry.id + "}";
  entry.op = text_at(*found, "op");
  announcement.unanswered = is_set("unanswered");
  announcement.answered = is_set("answered");
  entry.surely_not_sent = is_set("unsent");
  entry.refused = is_set("refused");
  entry.result = text_at(*found, "result");
  const auto moment = [&](const char* key) {
    return std::clamp<std::int64_t>(number<std::int64_t>(*found, key), 0, kLatestMs);
  };
  entry.received_ms = moment("received_ms");
  entry.deadline_ms = moment("deadline_ms");
  entry.response_topic = text_at(*found, "response_topic");
  if (auto correlation = from_hex(text_at(*found, "correlation")))
    entry.correlation = std::move(*correlation);
  const bool is_entry = is_name(entry.device) && !entry.id.empty() && entry.id.size() <= kLongestId;
  if (!is_plain(announcement.boot) || (announcement.mark == 0 && !is_entry)) return std::nullopt;
  return announcement;
}

std::optional<Result> result_from(std::string_view text) {
  const auto found = object_from(text);
  if (!found) return std::nullopt;
  Result result{text_at(*found, "id"), text_at(*found, "op"), text_at(*found, "status")};
  if (const json& id = member(*found, "id"); id.is_number_integer()) result.id = dumped(id);
  if (result.id.empty() || result.status.empty()) return std::nullopt;
  return result;
}

}  // namespace fxagent::pair_messages
