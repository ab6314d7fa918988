#include "agent/store/audit_chain.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "agent/text/json.h"
#include "agent/text/json_writer.h"

namespace fxagent::audit {
namespace {

using Json = nlohmann::json;

json::Writer begin_body(std::string_view kind, std::int64_t now_ms) {
  json::Writer out;
  out.begin_object().key("kind").string(kind).key("ts").integer(now_ms);
  return out;
}

std::string opening(std::uint64_t number, std::string_view prev) {
  return "{\"n\":" + std::to_string(number) + ",\"prev\":\"" + std::string(prev) + "\",";
}

std::string range(std::uint64_t from, std::uint64_t to) {
  if (from == to) return "record " + std::to_string(from) + " is missing";
  return "records " + std::to_string(from) + " to " + std::to_string(to) + " are missing";
}

bool same(ByteView kept_hash, const Digest& digest) {
  return std::equal(kept_hash.begin(), kept_hash.end(), digest.begin(), digest.end());
}

}  // namespace

Record seal(Head& head, std::string_view body) {
  Record record;
  record.number = head.records + 1;
  record.text = opening(record.number, to_text(head.hash)) + std::string(body.substr(1));
  head.records = record.number;
  head.hash = sha256(record.text);
  record.hash.assign(head.hash.begin(), head.hash.end());
  return record;
}

// ---- bodies of the chain's own records ---------------------------------------------------------

std::string pruned(std::uint64_t up_to, const Bytes& hash, std::int64_t now_ms) {
  json::Writer body = begin_body("pruned", now_ms);
  return body.key("up_to").integer(up_to).key("hash").string(to_text(hash)).end_object().take();
}

std::string begun(std::string_view set_aside, std::int64_t now_ms) {
  return begin_body("begun", now_ms).key("after").word(set_aside).end_object().take();
}

std::string lost(std::uint64_t records, std::int64_t now_ms) {
  return begin_body("lost", now_ms).key("records").integer(records).end_object().take();
}

std::int64_t time_of(std::string_view text) {
  const Json record = parsed_json(text);
  const Json& ts = member(record, "ts");
  return ts.is_number_integer() ? ts.get<std::int64_t>() : 0;
}

// ---- verification -----------------------------------------------------------------------------

void Verifier::find(std::uint64_t record, std::string text) {
  findings_.push_back({record, std::move(text)});
}

void Verifier::add(const Record& record) {
  const Digest digest = sha256(record.text);
  const bool whole = same(record.hash, digest);
  const auto follows = [&](std::string_view prev) {
    return record.text.starts_with(opening(record.number, prev));
  };
  if (!whole) find(record.number, "its text or its hash was changed");
  if (count_ == 0) {
    first_ = record.number;
    // check_beginning() compares this with the hash in the `pruned` record.
    const std::size_t at = opening(record.number, "").size() - 2;
    if (record.text.size() > at) first_prev_ = record.text.substr(at, 64);
    if (whole && !follows(first_prev_)) find(record.number, "it is a different record");
  } else if (record.number != last_ + 1) {
    find(last_ + 1, range(last_ + 1, record.number - 1));
  } else if (whole && !follows(to_text(last_hash_)) && !follows(to_text(last_digest_))) {
    find(record.number,
         "it does not follow record " + std::to_string(last_) + ": one of them was replaced");
  }
  const Json said = parsed_json(record.text);
  if (whole && text_at(said, "kind") == "pruned") {
    const Json& up_to = member(said, "up_to");
    const Json& hash = member(said, "hash");
    if (up_to.is_number_unsigned() && hash.is_string()) {
      pruned_up_to_ = up_to.get<std::uint64_t>();
      pruned_hash_ = hash.get<std::string>();
    } else {
      find(record.number, "it is not a record that this program writes");
    }
  }
  if (published_ && published_->records == record.number) published_here_ = digest;
  ++count_;
  last_ = record.number;
  last_hash_ = record.hash;
  last_digest_ = digest;
}

void Verifier::check_beginning() {
  if (count_ == 0) return;
  if (first_ == 1) {
    if (first_prev_ != to_text(Digest{}) && findings_.empty())
      find(1, "it is not the first record of a chain");
    return;
  }
  if (pruned_up_to_ + 1 < first_)
    find(pruned_up_to_ + 1,
         range(pruned_up_to_ + 1, first_ - 1) + ", and no record says that they were pruned");
  else if (pruned_up_to_ >= first_)
    find(first_, "it exists, although a later record says that it was pruned");
  else if (pruned_hash_ != first_prev_)
    find(first_, "it does not follow the last pruned record");
}

void Verifier::check_published(const Head& head) {
  if (!published_) return;
  const std::string at = std::to_string(published_->records);
  if (published_->records > head.records)
    return find(head.records + 1, "the head that was published counts " + at + " records");
  if (published_->records == 0 || published_->records < first_) return;  // pruned since
  if (published_here_ && *published_here_ == published_->hash) return;
  find(published_->records, "its hash is not the published one");
}

std::vector<Finding> Verifier::finish(const Head& head) {
  check_beginning();
  if (last_ < head.records)
    find(last_ + 1, range(last_ + 1, head.records) + " at the end");
  else if (last_ > head.records)
    find(head.records + 1, "the separately kept head ends before it");
  else if (count_ > 0 && !same(last_hash_, head.hash) && last_digest_ != head.hash)
    find(last_, "its hash is not that of the separately kept head");
  else if (count_ == 0 && head.hash != Digest{})
    find(0, "the separately kept head names a record, but there is none");
  check_published(head);
  return findings_;
}

}  // namespace fxagent::audit
