#include "agent/remote/kept_configs.h"

#include <nlohmann/json.hpp>
#include <utility>

namespace fxagent {
namespace {

using OrderedJson = nlohmann::ordered_json;

/// Version of the file format.
constexpr int kFormat = 1;
/// This many ends of the process in a row are not a coincidence.
constexpr int kMostEnds = 2;

OrderedJson json_of(const std::optional<KeptConfig>& kept) {
  if (!kept) return nullptr;
  return {
      {"document", kept->document.text}, {"hash", kept->document.hash}, {"since", kept->since_ms}};
}

/// Returns the kept config; nullopt for null. Throws if the JSON does not hold one.
std::optional<KeptConfig> kept_from(const OrderedJson& json) {
  if (json.is_null()) return std::nullopt;
  KeptConfig kept;
  ReadDesired read = read_desired(json.at("document").get_ref<const std::string&>());
  if (!read.errors.empty() || read.desired.hash != json.at("hash").get_ref<const std::string&>())
    throw std::runtime_error("a document in it does not match its hash");
  kept.document = std::move(read.desired);
  kept.since_ms = json.at("since").get<std::int64_t>();
  return kept;
}

}  // namespace

bool KeptConfigs::is_good(const std::optional<KeptConfig>& kept) const {
  return kept && good && kept->document.hash == good->document.hash;
}

std::string judge_last_run(KeptConfigs& kept, const std::string& boot, std::int64_t now_ms) {
  const auto roll_back = [&](const auto& document, const char* why) {
    kept.rolled_back = {document.hash, document.version, document.by, why, now_ms};
  };
  std::string judge_again;
  if (kept.judged && kept.stopped) {
    judge_again = std::exchange(kept.judged, {})->text;
  } else if (kept.judged) {  // so neither the config on trial nor the good one is to blame
    roll_back(*std::exchange(kept.judged, {}), "the process ended during the check of the config");
  } else if (kept.trying && !kept.stopped) {
    roll_back(std::exchange(kept.trying, {})->document,
              "the process ended during the trial of the config");
  } else if (kept.watched && kept.good && kept.boot == boot && ++kept.ends >= kMostEnds) {
    roll_back(std::exchange(kept.good, std::exchange(kept.before, {}))->document,
              "the process ended twice within an hour of its start while the config was in force");
    kept.ends = 0;
  }
  kept.stopped = false;  // later ends count against the config again
  return judge_again;
}

std::string to_text(const KeptConfigs& kept) {
  OrderedJson json{{"format", kFormat},          {"agent", kept.agent},
                   {"good", json_of(kept.good)}, {"before", json_of(kept.before)},
                   {"watched", kept.watched},    {"ends", kept.ends},
                   {"boot", kept.boot},          {"trying", json_of(kept.trying)},
                   {"stopped", kept.stopped},    {"judged", nullptr},
                   {"rolled_back", nullptr}};
  if (const auto& judged = kept.judged)
    json["judged"] = {{"document", judged->text},
                      {"hash", judged->hash},
                      {"version", judged->version},
                      {"by", judged->by}};
  if (const auto& back = kept.rolled_back)
    json["rolled_back"] = {{"hash", back->hash},
                           {"version", back->version},
                           {"by", back->by},
                           {"why", back->why},
                           {"since", back->since_ms}};
  return json.dump(1, ' ', false, OrderedJson::error_handler_t::replace) + "\n";
}

tl::expected<KeptConfigs, std::string> kept_configs_from(std::string_view text) {
  try {
    const OrderedJson json = OrderedJson::parse(text);
    if (json.at("format") != kFormat)
      return tl::unexpected(std::string("another version of the agent wrote it"));
    KeptConfigs kept;
    kept.agent = json.at("agent").get<std::string>();
    kept.good = kept_from(json.at("good"));
    // Files of earlier versions of the agent lack these.
    kept.before = kept_from(json.value("before", OrderedJson()));
    kept.watched = json.value("watched", false);
    kept.ends = json.value("ends", 0);
    kept.boot = json.value("boot", "");
    kept.trying = kept_from(json.at("trying"));
    kept.stopped = json.at("stopped").get<bool>();
    const auto word = [](const OrderedJson& of, const char* key) {
      return of.at(key).get<std::string>();
    };
    if (const OrderedJson& judged = json.at("judged"); !judged.is_null())
      kept.judged = {judged.value("document", ""), word(judged, "hash"), word(judged, "version"),
                     word(judged, "by")};
    if (const OrderedJson& back = json.at("rolled_back"); !back.is_null())
      kept.rolled_back = {word(back, "hash"), word(back, "version"), word(back, "by"),
                          word(back, "why"), back.at("since").get<std::int64_t>()};
    return kept;
  } catch (const OrderedJson::parse_error& fault) {
    return tl::unexpected("it is truncated or was changed: not JSON from byte " +
                          std::to_string(fault.byte) + " on");
  } catch (const OrderedJson::exception&) {
    return tl::unexpected(std::string("it was changed: a part is missing, or has the wrong type"));
  } catch (const std::exception& fault) {
    return tl::unexpected(std::string(fault.what()));
  }
}

}  // namespace fxagent
