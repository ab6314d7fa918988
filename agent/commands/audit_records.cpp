#include "agent/commands/audit_records.h"

#include <nlohmann/json.hpp>

#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent::audit {
namespace {

using Json = nlohmann::ordered_json;

std::string kept(std::string_view text) {
  return escaped(text.substr(0, kPayloadKept), Escape::record);
}

Json word(std::string_view text) { return text.empty() ? Json(nullptr) : Json(kept(text)); }

Json body_of(const char* kind, std::int64_t now_ms) { return {{"kind", kind}, {"ts", now_ms}}; }

void add_receipt(Json& body, const Receipt& receipt) {
  body["arrival"] = receipt.number;
  body["device"] = receipt.device;
  body["topic"] = kept(receipt.topic);
  body["received"] = receipt.received_ms;
  body["retained"] = receipt.retained;
  body["by"] = word(receipt.by);
  body["payload"] = kept(receipt.payload);
  body["payload_bytes"] = receipt.payload_bytes;
}

/// Leaves out the first result inside a DUPLICATE, which has a record of its own.
Json outcome_of(std::string_view result_text) {
  Json outcome = parsed_ordered_json(result_text);
  if (!outcome.is_object()) return nullptr;
  outcome.erase("first");
  if (dumped(outcome).size() <= kResultKept) return outcome;
  for (const char* key : {"value", "verify", "targets"})
    if (outcome.contains(key)) outcome[key] = nullptr;
  outcome["cut"] = true;
  return outcome;
}

}  // namespace

std::string answered(const Receipt& receipt, std::string_view result_text, std::int64_t now_ms) {
  Json body = body_of("answered", now_ms);
  add_receipt(body, receipt);
  body["result"] = outcome_of(result_text);
  return dumped(body);
}

std::string admitted(const Receipt& receipt, std::string_view id, std::string_view op,
                     std::int64_t now_ms) {
  Json body = body_of("ordered", now_ms);
  add_receipt(body, receipt);
  body["id"] = id;
  body["op"] = op;
  return dumped(body);
}

std::string announced(const JournalEntry& entry, std::string_view topic, std::int64_t now_ms) {
  return admitted({.number = entry.number,
                   .device = entry.device,
                   .topic = std::string(topic),
                   .received_ms = entry.received_ms},
                  entry.id, entry.op, now_ms);
}

std::string result(std::uint64_t number, std::string_view device, std::string_view result_text,
                   const FrameTrace& frames, std::int64_t now_ms) {
  Json body = body_of("result", now_ms);
  body["arrival"] = number;
  body["device"] = device;
  body["result"] = outcome_of(result_text);
  Json& wire = body["frames"] = Json::array();
  for (const WireFrame& frame : frames.frames())
    wire.push_back({{frame.way == WireFrame::Way::out ? "out" : "in", to_hex(frame.bytes)}});
  body["frames_omitted"] = frames.omitted();
  return dumped(body);
}

std::string delivery(std::uint64_t number, std::string_view device, std::string_view id,
                     bool acknowledged, std::int64_t now_ms) {
  Json body = body_of("told", now_ms);
  body["arrival"] = number;
  body["device"] = device;
  body["id"] = word(id);
  body["acknowledged"] = acknowledged;
  return dumped(body);
}

std::string config(const ConfigReceipt& receipt, std::string_view topic, std::int64_t now_ms) {
  Json body = body_of("config", now_ms);
  body["topic"] = kept(topic);
  body["version"] = word(receipt.version);
  body["by"] = word(receipt.by);
  body["state"] = receipt.state;
  body["desired_hash"] = word(receipt.desired_hash);
  body["hash"] = receipt.hash;
  Json& errors = body["errors"] = Json::array();
  for (const std::string& error : receipt.errors) {
    if (errors.size() == kErrorsKept) break;
    errors.push_back(kept(error));
  }
  body["errors_in_all"] = receipt.errors_in_all;
  return dumped(body);
}

}  // namespace fxagent::audit
