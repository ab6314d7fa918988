#include "agent/cli/subcommands.h"

#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "agent/cli/audit/audit_report.h"
#include "agent/cli/exit_status.h"
#include "agent/steady_time.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_file.h"
#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

/// Parses "17:0f3a…", the records and head of a health message; nullopt for any other text.
std::optional<audit::Head> head_from(const std::string& text) {
  const std::size_t colon = text.find(':');
  if (colon == 0 || colon == std::string::npos || colon > 18) return std::nullopt;
  if (text.find_first_not_of("0123456789") != colon) return std::nullopt;
  const auto digest = from_hex(text.substr(colon + 1));
  audit::Head head;
  if (!digest || digest->size() != head.hash.size()) return std::nullopt;
  head.records = std::stoull(text.substr(0, colon));
  std::copy(digest->begin(), digest->end(), head.hash.begin());
  return head;
}

int print_findings(const audit::Verifier& verifier, const audit::Head& head,
                   const std::vector<audit::Finding>& findings, bool as_json) {
  const std::string hash = to_text(head.hash);
  if (as_json) {
    nlohmann::ordered_json out;
    out["ok"] = findings.empty();
    out["records"] = head.records;
    out["head"] = hash;
    out["present"] = verifier.records();
    auto& list = out["findings"] = nlohmann::ordered_json::array();
    for (const audit::Finding& finding : findings)
      list.push_back({{"record", finding.record}, {"text", finding.text}});
    std::cout << dumped(out) << '\n';
  } else {
    for (const audit::Finding& finding : findings)
      std::cout << "record " << finding.record << ": " << finding.text << '\n';
    std::cout << (findings.empty() ? "whole: " : "NOT whole: ")
              << counted(verifier.records(), "record") << ", head " << head.records << ":" << hash
              << '\n';
  }
  return findings.empty() ? kDone : kFailed;
}

void name_set_aside(const std::string& directory) {
  std::error_code fault;
  for (const auto& entry : std::filesystem::directory_iterator(directory, fault)) {
    const std::string name = entry.path().filename().string();
    if (name.find(".corrupt-") == std::string::npos || name.ends_with("-wal") ||
        name.ends_with("-shm"))
      continue;
    std::cerr << "fxagent audit: a damaged store file was set aside with its records: " << name
              << '\n';
  }
}

}  // namespace

int run_audit(const Config& config, const AuditQuestion& question) {
  const auto refuse = [](const std::string& why) { return refused("fxagent audit", why); };
  if (config.store.path.empty())
    return refuse(
        "there is no audit, because it is part of the store. Set store.path in the "
        "config; the agent then records every command for its devices");
  std::optional<std::int64_t> since;
  if (!question.since.empty()) {
    since = audit::since_from(question.since, utc_now_ms());
    if (!since)
      return refuse("--since takes ms UTC, 2026-11-21, 2026-11-21T08:30, or 90s, 30m, 2h, 7d");
  }
  std::optional<audit::Head> published;
  if (!question.head.empty()) {
    published = head_from(question.head);
    if (!published)
      return refuse("--head takes RECORDS:HASH, as audit.records and audit.head in health");
  }
  const std::string path = store_file_path(config.store.path);
  std::error_code fault;
  const bool exists = std::filesystem::exists(path, fault);
  if (fault)
    return refuse(path + ": " + fault.message() +
                  (fault == std::errc::permission_denied
                       ? "; run this as the user of the store, or as root"
                       : ""));
  if (!exists) return refuse(path + " does not exist; the agent creates it when it runs");
  audit::Verifier verifier(published);
  audit::Report report;
  audit::Head head;
  const auto take = [&](audit::Record record) {
    question.verify ? verifier.add(record) : report.add(record);
  };
  if (const auto unread = AuditTrail::read(path, take, head)) {
    if (question.verify && unread->is_damaged)
      return print_findings(verifier, head,
                            {{verifier.records() + 1, "the file is damaged: " + unread->why}},
                            question.as_json);
    return refuse(path + ": " + unread->why);
  }
  name_set_aside(config.store.path);
  if (question.verify)
    return print_findings(verifier, head, verifier.finish(head), question.as_json);
  for (const audit::Line& line : report.take())
    if (!since || line.at_ms >= *since)
      std::cout << (question.as_json ? line.json : line.text) << '\n';
  return kDone;
}

}  // namespace fxagent
