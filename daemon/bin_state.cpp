// What comes back from the disk is checked like what comes from a client: a damaged state must not become book data.
#include "daemon/bin_state.h"

#include <chrono>
#include <cstdint>
#include <stdexcept>

namespace granary {
namespace {

using Json = nlohmann::ordered_json;

std::int64_t UtcNs(UtcTime utc) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(utc.time_since_epoch()).count();
}

/// Adds when and by whom to `json`.
Json Signed(Json json, UtcTime utc, const std::string& who) {
  json["utc_ns"] = UtcNs(utc);
  json["who"] = who;
  return json;
}

template <typename Signature>
void ReadSignature(const Json& json, Signature& signature) {
  const auto since_epoch = std::chrono::nanoseconds{json.at("utc_ns").get<std::int64_t>()};
  signature.utc = UtcTime{std::chrono::duration_cast<UtcTime::duration>(since_epoch)};
  signature.who = json.at("who").get<std::string>();
}

BinState::Book ReadBook(const Json& json) {
  BinState::Book book;
  book.data = {.book_mass_kg = json.at("book_mass_kg").get<double>(),
               .density_kg_m3 = json.at("density_kg_m3").get<double>(),
               .correction = json.at("correction").get<double>(),
               .loss_kg = json.at("loss_kg").get<double>()};
  ReadSignature(json, book);
  const auto faults = Faults(book.data);
  if (!faults.empty()) throw std::invalid_argument("state: book: " + faults.front());
  return book;
}

RegisterFormat ReadFormat(const Json& json) {
  const int byte_order = json.at("byte_order").get<int>();
  const int invalid = json.at("invalid").get<int>();
  if (byte_order < 0 || byte_order > 3) throw std::invalid_argument("state: format: byte_order: must be 0 to 3");
  if (invalid < 0 || invalid > 2) throw std::invalid_argument("state: format: invalid: must be 0 to 2");
  return {static_cast<ByteOrder>(byte_order), static_cast<InvalidPolicy>(invalid)};
}

Json OrNull(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

}  // namespace

Json BookToJson(const Inventory& inventory) {
  return {{"book_mass_kg", OrNull(inventory.book_mass_kg)},
          {"density_kg_m3", OrNull(inventory.density_kg_m3)},
          {"correction", inventory.correction},
          {"loss_kg", inventory.loss_kg}};
}

Json FormatToJson(const RegisterFormat& format) {
  return {{"byte_order", static_cast<int>(format.byte_order)}, {"invalid", static_cast<int>(format.invalid)}};
}

Json StateToJson(const BinState& state) {
  Json json = Json::object();
  if (state.book) json["book"] = Signed(BookToJson(WithBook({}, state.book->data)), state.book->utc, state.book->who);
  if (state.format) json["format"] = FormatToJson(*state.format);
  if (state.inhibition) json["inhibition"] = Signed(Json::object(), state.inhibition->utc, state.inhibition->who);
  if (state.abnormal_latched) json["abnormal_latched"] = *state.abnormal_latched;
  return json;
}

BinState StateFromJson(const Json& json) {
  BinState state;
  try {
    if (!json.is_object()) throw std::invalid_argument("state: must be an object");
    if (json.contains("book")) state.book = ReadBook(json["book"]);
    if (json.contains("format")) state.format = ReadFormat(json["format"]);
    if (json.contains("inhibition")) ReadSignature(json["inhibition"], state.inhibition.emplace());
    if (json.contains("abnormal_latched")) state.abnormal_latched = json["abnormal_latched"].get<bool>();
  } catch (const nlohmann::json::exception& error) {
    throw std::invalid_argument(std::string("state: ") + error.what());
  }
  return state;
}

}  // namespace granary
